#include "export/height_sampler.h"

#include "math/linalg.h"
#include "tile/model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MIN_ALPHA 0.5f
#define MIN_OBSERVATIONS 3u /* of a sparse point that heights are taken from */
/* Transmittance of a ray at the surface; haze above it takes the rest. Tuned on one survey at preview quality
 * (brighton, against its sparse points: the mean depth is 1.80 m off, 0.5: 0.92 m, 0.3: 0.56 m, 0.15: 0.45 m); on
 * solid surfaces all agree. */
#define SURFACE_LEFT 0.15
#define CHUNK 256 /* places a task */

/* The heights of the sparse points with a margin, without a few per mille that may be wrong. */
static cn_status find_heights(cn_height_sampler *s)
{
    const cn_scene *scene = s->survey->scene;
    double *z = malloc((scene->n_points + 1u) * sizeof *z), radius = 0;
    size_t n = 0;
    if (!z) return cn_fail(CN_ERR_NOMEM, "out of memory for the heights of %u points", scene->n_points);
    for (uint32_t i = 0; i < scene->n_points; i++)
        if (scene->points[i].n_observations >= MIN_OBSERVATIONS) z[n++] = scene->points[i].xyz[2];
    if (n) {
        const double high = cn_select(z, n, n - 1 - n / 500), low = cn_select(z, n, n / 500);
        s->top_m = high + 0.1 * (high - low) + 1e-3;
        s->bottom_m = low - 0.5 * (high - low) - 1e-3;
        free(z);
        return CN_OK;
    }
    free(z);
    for (uint32_t t = 0; t < s->survey->n_tiles; t++)
        radius = fmax(radius, s->survey->tiles[t].radius_m);
    s->top_m = -INFINITY;
    s->bottom_m = INFINITY;
    for (uint32_t i = 0; i < scene->n_views; i++) {
        double centre[3];
        cn_view_centre(&scene->views[i], centre);
        s->top_m = fmax(s->top_m, centre[2]);
        s->bottom_m = fmin(s->bottom_m, centre[2] - 10 * radius);
    }
    return scene->n_views ? CN_OK : cn_fail(CN_ERR_DATA, "no photo has a pose; run `conurb poses` first");
}

cn_status cn_height_sampler_init(cn_height_sampler *s, const cn_context *ctx, const cn_survey *survey)
{
    *s = (cn_height_sampler){ .survey = survey };
    if (ctx) s->ctx = *ctx;
    return find_heights(s);
}

/* Trees have few sparse points, so their crowns may be above all points. Photos from the air give a safe limit: space
 * is empty nearer to the lowest of them than the tile's near distance. */
static void find_start(cn_height_sampler *s)
{
    double lowest = INFINITY;
    for (uint32_t i = 0; i < s->place->n_views; i++) {
        double centre[3];
        cn_view_centre(&s->survey->scene->views[s->place->views[i]], centre);
        lowest = fmin(lowest, centre[2]);
    }
    const double clear = lowest - s->tile->box.near_m;
    s->start_m = isfinite(clear) && clear > s->top_m ? clear : s->top_m;
}

cn_status cn_height_sampler_open(cn_height_sampler *s, uint32_t tile)
{
    cn_tile_close(&s->tile);
    s->place = &s->survey->tiles[tile];
    CN_TRY(cn_tile_open(&s->tile, s->place->path));
    find_start(s);
    s->render = s->survey->render;
    s->render.depth_left = SURFACE_LEFT;
    s->render.appearance = NULL;
    if (!s->survey->appearance) return CN_OK;
    CN_TRY(s->survey->appearance(s->survey->appearance_user, &s->ctx, s->tile, &s->row));
    s->render.appearance = &s->row;
    return CN_OK;
}

void cn_height_sampler_deinit(cn_height_sampler *s)
{
    cn_tile_close(&s->tile);
}

bool cn_height_sampler_sees(const cn_height_sampler *s, const double xyz[3], uint32_t wanted, double margin)
{
    const cn_scene *scene = s->survey->scene;
    const uint32_t n = s->place->n_views;
    uint32_t left = wanted < n ? wanted : n;
    for (uint32_t i = 0; i < n && left; i++) {
        const cn_view *view = &scene->views[s->place->views[i]];
        const cn_camera *camera = &scene->cameras[view->camera];
        double there[3], px[2];
        cn_mat3_vec(view->rotation, xyz, there);
        for (int k = 0; k < 3; k++)
            there[k] += view->translation[k];
        if (!cn_camera_project(camera, there, px)) continue;
        const double x = margin * camera->width, y = margin * camera->height;
        left -= px[0] >= -x && px[0] <= camera->width + x && px[1] >= -y && px[1] <= camera->height + y;
    }
    return left == 0 && n > 0;
}

cn_status cn_height_samples_init(cn_height_samples *s, size_t room)
{
    *s = (cn_height_samples){ .room = room };
    s->top = malloc(room * sizeof *s->top);
    s->down = malloc(room * sizeof *s->down);
    s->weight = malloc(room * sizeof *s->weight);
    s->below_m = malloc(room * sizeof *s->below_m);
    s->rgba = malloc(room * sizeof *s->rgba);
    s->origin = malloc(room * sizeof *s->origin);
    s->direction = malloc(room * sizeof *s->direction);
    s->found = malloc(room * sizeof *s->found);
    s->depth = malloc(room * sizeof *s->depth);
    s->which = malloc(room * sizeof *s->which);
    if (s->top && s->down && s->weight && s->below_m && s->rgba && s->origin && s->direction && s->found && s->depth &&
        s->which)
        return CN_OK;
    cn_height_samples_deinit(s);
    return cn_fail(CN_ERR_NOMEM, "out of memory for %zu height samples", room);
}

void cn_height_samples_deinit(cn_height_samples *s)
{
    void *const parts[] = { s->top,    s->down,      s->weight, s->below_m, s->rgba,
                            s->origin, s->direction, s->found,  s->depth,   s->which };
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++)
        free(parts[i]);
    *s = (cn_height_samples){ 0 };
}

typedef struct looking {
    cn_height_sampler *sampler;
    cn_height_samples *samples;
    size_t n_rays;
    double lift_m;
} looking;

/* The blend weight of the open tile at a place. It falls to 0 at its reach, so that there is no visible edge. */
static double weight_at(const cn_height_sampler *s, const double xyz[3])
{
    const double radius = s->place->radius_m, reach = s->survey->reach * radius;
    const double d = hypot(xyz[0] - s->place->centre[0], xyz[1] - s->place->centre[1]);
    if (!(d < reach)) return 0;
    const double u = d / reach, fall = (1 - u * u) * (1 - u * u);
    /* The minimum keeps the fringe of a tile that has no neighbour there. */
    return pow(radius / fmax(d, 0.01 * radius), s->survey->exponent) * fmax(fall, 1e-6);
}

/* Whether a photo may see a part of the vertical line: tests some heights, denser near the top. */
static bool in_sight(const cn_height_sampler *s, const double top[3], const double down[3])
{
    for (double part = 1.0 / 32; part <= 1; part *= 2) {
        double at[3];
        for (int k = 0; k < 3; k++)
            at[k] = top[k] + part * (s->top_m - s->bottom_m) * down[k];
        if (cn_height_sampler_sees(s, at, 1, 0.25)) return true;
    }
    return false;
}

/* Leaves out places where the tile has no weight, to save rays. */
static void pick(void *user, size_t chunk, unsigned worker)
{
    looking *l = user;
    const cn_height_sampler *s = l->sampler;
    cn_height_samples *q = l->samples;
    (void)worker;
    for (size_t i = chunk * CHUNK; i < (chunk + 1) * CHUNK && i < q->n; i++)
        q->weight[i] = weight_at(s, q->top[i]) > 0 && in_sight(s, q->top[i], q->down[i]) ? 1 : 0;
}

/* Converts the rays' results to height samples. */
static void take_samples(void *user, size_t chunk, unsigned worker)
{
    looking *l = user;
    cn_height_samples *q = l->samples;
    (void)worker;
    for (size_t r = chunk * CHUNK; r < (chunk + 1) * CHUNK && r < l->n_rays; r++) {
        const uint32_t i = q->which[r];
        const double below = q->depth[r] - l->lift_m, range = l->sampler->top_m - l->sampler->bottom_m;
        double at[3];
        for (int k = 0; k < 3; k++)
            at[k] = q->top[i][k] + below * q->down[i][k];
        const bool there =
            q->found[r][3] >= MIN_ALPHA && below <= range && cn_height_sampler_sees(l->sampler, at, 2, 0);
        q->weight[i] = there ? (float)(weight_at(l->sampler, at) * q->found[r][3]) : 0;
        q->below_m[i] = (float)below;
        memcpy(q->rgba[i], q->found[r], sizeof q->rgba[i]);
    }
}

cn_status cn_height_sampler_down(cn_height_sampler *s, cn_height_samples *q)
{
    /* A tile's rays begin at its near distance: put the origin accordingly. */
    looking l = { s, q, 0, s->tile->box.near_m * (1 + s->tile->box.step) + s->start_m - s->top_m };
    cn_pool_run(s->ctx.pool, (q->n + CHUNK - 1) / CHUNK, pick, &l);
    for (size_t i = 0; i < q->n; i++) {
        if (!(q->weight[i] > 0)) continue;
        for (int k = 0; k < 3; k++) {
            q->direction[l.n_rays][k] = q->down[i][k];
            q->origin[l.n_rays][k] = q->top[i][k] - l.lift_m * q->down[i][k];
        }
        q->which[l.n_rays++] = (uint32_t)i;
    }
    CN_TRY(cn_render_rays(&s->ctx, s->tile,
                          &(cn_ray_list){ l.n_rays, (const double(*)[3])q->origin, (const double(*)[3])q->direction },
                          &s->render, &q->found[0][0], q->depth));
    cn_pool_run(s->ctx.pool, (l.n_rays + CHUNK - 1) / CHUNK, take_samples, &l);
    return CN_OK;
}
