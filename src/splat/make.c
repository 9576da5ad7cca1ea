/* Splats from a field, and pictures of splats. */
#include "conurb/splat.h"

#include "base/clock.h"
#include "splat/fit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define NEAR 0.1f /* by the distance that one in a hundred is nearer than: what is nearer to the camera is left out */
#define LEAST_NEAR_M 1e-3f /* nearer, the projection loses precision in float */
enum { SAMPLES = 4096 };   /* Gaussians that tell how near the nearest are */
#define SEEDS 0.8          /* part of the budget; the rest is put where the pictures differ */

cn_splat_options cn_splat_options_default(void)
{
    return (cn_splat_options){ .budget = 1000000, .degree = 0, .rounds = 10 };
}

static cn_status check(const cn_splat_options *o)
{
    if (o->budget < 1000 || o->budget > 50000000)
        return cn_fail(CN_ERR_USAGE, "a budget of %u splats: give 1000 to 50000000", o->budget);
    if (o->degree > CN_SPLAT_MAX_DEGREE)
        return cn_fail(CN_ERR_USAGE, "spherical harmonics of degree %u: give 0 to %d", o->degree, CN_SPLAT_MAX_DEGREE);
    if (!(o->limit_s >= 0) || o->rounds > 10000)
        return cn_fail(CN_ERR_USAGE, "a fit of %u rounds or %g seconds", o->rounds, o->limit_s);
    return CN_OK;
}

static cn_status to_splats(const cn_splat_set *set, cn_splats **splats)
{
    const uint32_t length = cn_row_length(set->degree), colours = length - CN_ROW_COLOUR;
    CN_TRY(cn_splats_create(splats, set->n, set->degree));
    cn_splats *s = *splats;
    memcpy(s->origin, set->origin, sizeof s->origin);
    for (size_t i = 0; i < set->n; i++) {
        const float *row = set->rows + i * length, *q = row + CN_ROW_ROTATION;
        const float norm = fmaxf(sqrtf(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), 1e-12f);
        for (int k = 0; k < 3; k++) {
            s->centre[i][k] = row[CN_ROW_CENTRE + k];
            s->scale[i][k] = expf(fminf(fmaxf(row[CN_ROW_SCALE + k], -40), 40));
        }
        for (int k = 0; k < 4; k++)
            s->rotation[i][k] = q[k] / norm;
        s->opacity[i] = 1 / (1 + expf(-row[CN_ROW_OPACITY]));
        memcpy(s->colour + i * colours, row + CN_ROW_COLOUR, colours * sizeof(float));
    }
    return CN_OK;
}

static cn_status seed_and_fit(cn_splat_set *set, const cn_context *ctx, const cn_targets *targets,
                              const cn_splat_options *options, cn_splat_report *report)
{
    const size_t most = set->room;
    set->room = (size_t)fmax(1, SEEDS * (double)most);
    CN_TRY(cn_seeds_make(set, ctx, targets));
    set->room = most;
    report->n_seeds = set->n;
    report->n_views = targets->n;
    return cn_splat_fit(set, ctx, targets, options, report);
}

cn_status cn_splats_make(const cn_context *ctx, const cn_splat_source *source, const cn_splat_options *options,
                         const char *path, cn_splats **splats, cn_splat_report *report)
{
    const double started = cn_now_s();
    cn_splat_report mine = { 0 };
    cn_targets targets;
    cn_splat_set set = { .room = options->budget, .degree = options->degree };
    *splats = NULL;
    CN_TRY(check(options));
    CN_TRY(cn_targets_make(&targets, ctx, source, options->budget, path));
    mine.render_s = cn_now_s() - started;
    set.rows = malloc(set.room * cn_row_length(set.degree) * sizeof *set.rows);
    cn_status status = set.rows ? seed_and_fit(&set, ctx, &targets, options, &mine)
                                : cn_fail(CN_ERR_NOMEM, "out of memory for %zu splats", set.room);
    if (status == CN_OK) status = to_splats(&set, splats);
    free(set.rows);
    cn_targets_deinit(&targets);
    if (report) *report = mine;
    return status;
}

/* ---- pictures ---- */

static void to_row(const cn_splats *s, size_t i, float *row)
{
    const size_t colours = (size_t)3 * (s->degree + 1) * (s->degree + 1);
    const float opacity = fminf(fmaxf(s->opacity[i], 1e-6f), 1 - 1e-6f);
    for (int k = 0; k < 3; k++) {
        row[CN_ROW_CENTRE + k] = s->centre[i][k];
        row[CN_ROW_SCALE + k] = logf(s->scale[i][k]);
    }
    memcpy(row + CN_ROW_ROTATION, s->rotation[i], sizeof s->rotation[i]);
    row[CN_ROW_OPACITY] = logf(opacity / (1 - opacity));
    memcpy(row + CN_ROW_COLOUR, s->colour + i * colours, colours * sizeof(float));
}

static int by_value(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Distance from which a view shows Gaussians: a tenth of that of its nearest ones, however far the others are. */
static float near_of(const cn_splats *splats, const cn_view *view)
{
    float z[SAMPLES];
    size_t n = 0;
    for (size_t i = 0; i < SAMPLES && i < splats->n; i++) {
        const float *centre = splats->centre[splats->n > SAMPLES ? i * splats->n / SAMPLES : i];
        double at = view->translation[2];
        for (int a = 0; a < 3; a++)
            at += view->rotation[6 + a] * (splats->origin[a] + (double)centre[a]);
        if (at > 0) z[n++] = (float)at;
    }
    if (!n) return LEAST_NEAR_M;
    qsort(z, n, sizeof *z, by_value);
    return fmaxf(NEAR * z[n / 100], LEAST_NEAR_M);
}

cn_status cn_splats_render(const cn_context *ctx, const cn_splats *splats, const cn_camera *camera, const cn_view *view,
                           float *rgb)
{
    const uint32_t length = cn_row_length(splats->degree);
    const cn_splat_camera from = cn_splat_camera_of(camera, view, splats->origin, near_of(splats, view));
    float *rows = malloc((splats->n + 1) * length * sizeof *rows);
    cn_raster raster = { 0 };
    cn_status status = rows ? cn_raster_init(&raster, ctx->pool, cn_splat_kernel_best(), splats->n)
                            : cn_fail(CN_ERR_NOMEM, "out of memory for %zu splats", splats->n);
    for (size_t i = 0; status == CN_OK && i < splats->n; i++)
        to_row(splats, i, rows + i * length);
    const cn_splat_rows all = { rows, splats->n, splats->degree };
    if (status == CN_OK) status = cn_raster_bin(&raster, &from, &all);
    if (status == CN_OK) cn_raster_draw(&raster, &from, rgb, NULL);
    cn_raster_deinit(&raster);
    free(rows);
    return status;
}
