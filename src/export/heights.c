/* Heights at single places, and the photos' ground sampling distance. */
#include "export/height_sampler.h"

#include "math/linalg.h"
#include "pose/lens.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { ROOM = 16384, MOST_POINTS = 200000 };

static void add(const cn_height_sampler *s, const cn_height_samples *q, size_t first, double *sum, double *weight)
{
    for (size_t i = 0; i < q->n; i++) {
        if (!(q->weight[i] > 0)) continue;
        sum[first + i] += q->weight[i] * (s->top_m - q->below_m[i]);
        weight[first + i] += q->weight[i];
    }
}

static cn_status sound_tile(cn_height_sampler *s, cn_height_samples *q, size_t n, const double (*xy_m)[2], double *sum,
                            double *weight)
{
    for (size_t first = 0; first < n; first += ROOM) {
        if (cn_stopping(&s->ctx))
            return cn_fail(CN_ERR_INTERRUPTED, "stopped while measuring heights; run the same command again");
        q->n = n - first < ROOM ? n - first : ROOM;
        for (size_t i = 0; i < q->n; i++) {
            const double top[3] = { xy_m[first + i][0], xy_m[first + i][1], s->top_m }, down[3] = { 0, 0, -1 };
            memcpy(q->top[i], top, sizeof top);
            memcpy(q->down[i], down, sizeof down);
        }
        CN_TRY(cn_height_sampler_down(s, q));
        add(s, q, first, sum, weight);
    }
    return CN_OK;
}

cn_status cn_export_heights(const cn_context *ctx, const cn_survey *survey, size_t n, const double (*xy_m)[2],
                            double *ground_m)
{
    cn_height_sampler s;
    cn_height_samples q;
    CN_TRY(cn_height_sampler_init(&s, ctx, survey));
    double *weight = calloc(n + 1, sizeof *weight);
    if (!weight) return cn_fail(CN_ERR_NOMEM, "out of memory for %zu height samples", n);
    cn_status status = cn_height_samples_init(&q, n < ROOM ? n + 1 : ROOM);
    memset(ground_m, 0, n * sizeof *ground_m);
    for (uint32_t t = 0; t < survey->n_tiles && status == CN_OK; t++) {
        status = cn_height_sampler_open(&s, t);
        if (status == CN_OK) status = sound_tile(&s, &q, n, xy_m, ground_m, weight);
    }
    for (size_t i = 0; i < n; i++)
        ground_m[i] = weight[i] > 0 ? ground_m[i] / weight[i] : NAN;
    cn_height_samples_deinit(&q);
    cn_height_sampler_deinit(&s);
    free(weight);
    return status;
}

/* Metres per pixel, at the working width, of one place in one view. */
static double pixel_size(const cn_survey *survey, const cn_view *view, const double xyz[3])
{
    const cn_camera *c = &survey->scene->cameras[view->camera];
    double centre[3];
    cn_view_centre(view, centre);
    return cn_distance3(centre, xyz) / (cn_lens_unpack(c).fx * survey->width_px / c->width);
}

double cn_export_gsd(const cn_survey *survey)
{
    const cn_scene *scene = survey->scene;
    const uint32_t step = scene->n_points / MOST_POINTS + 1;
    double *size = malloc((scene->n_points / step + 1) * sizeof *size), gsd = 0;
    size_t n = 0;
    for (uint32_t i = 0; size && i < scene->n_points; i += step) {
        const cn_point *p = &scene->points[i];
        if (!p->n_observations) continue;
        size[n++] = pixel_size(survey, &scene->views[scene->observations[p->first_observation].view], p->xyz);
    }
    if (n) gsd = cn_select(size, n, n / 2);
    free(size);
    for (uint32_t t = 0; n == 0 && t < survey->n_tiles; t++)
        gsd = fmax(gsd, survey->tiles[t].radius_m / 1000);
    if (!(gsd > 0 && isfinite(gsd))) return 1;
    const double unit = pow(10, floor(log10(gsd)) - 1);
    return round(gsd / unit) * unit;
}
