#include "stage/splat_lights.h"

#include "base/clock.h"
#include "base/srgb.h"
#include "base/units.h"
#include "math/linalg.h"
#include "stage/splat.h"
#include "tile/model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { BATCH = 16384, MOST_VIEWS = 96 };
#define MIN_ALPHA 0.1f
#define FLOOR 0.004 /* linear light that counts as black in ratios */
#define MOST_RATIO 2.0
#define BEFORE 3.0  /* a ray begins so many of the splat's largest deviations in front of it */
#define SKY_DEG 4.0 /* the horizon's colour is taken this much above it */

typedef struct job {
    const cn_splat_lights *l;
    const cn_splats *splats;
    uint8_t (*const *colours)[3];
    double above[3];            /* a place with a free view of the sky */
    double near_m;              /* a ray of the tile sees nothing nearer to its origin */
    double centre[3], radius_m; /* of the tile */
    const cn_view **views;      /* of the tile, evenly */
    uint32_t n_views;
    uint32_t *which; /* splats, tile by tile */
    uint32_t first, n;
    double (*origin)[3], (*direction)[3];
    float (*rgba)[4], (*display)[3], (*own)[3], *depth; /* own: the field's under the first light */
    bool *fine;
    uint64_t done;
    double started;
} job;

static void axis_of(const float q[4], int k, double axis[3])
{
    const double w = (double)q[0], x = (double)q[1], y = (double)q[2], z = (double)q[3];
    const double m[9] = { 1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                          2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                          2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y) };
    for (int r = 0; r < 3; r++)
        axis[r] = m[3 * r + k];
}

static int flattest(const float scale[3])
{
    int least = 0;
    for (int k = 1; k < 3; k++)
        if (scale[k] < scale[least]) least = k;
    return least;
}

/* Whether the view's picture has the place. */
static bool shows(const cn_scene *scene, const cn_view *view, const double at[3])
{
    const cn_camera *camera = &scene->cameras[view->camera];
    double in[3], pixel[2];
    cn_mat3_vec(view->rotation, at, in);
    for (int k = 0; k < 3; k++)
        in[k] += view->translation[k];
    return cn_camera_project(camera, in, pixel) && pixel[0] >= 0 && pixel[1] >= 0 && pixel[0] < camera->width &&
           pixel[1] < camera->height;
}

/* In the middle of the tiles, above all eyes and all but the highest sparse points. */
static cn_status place_above(const cn_survey *survey, double above[3])
{
    const cn_scene *scene = survey->scene;
    double *z = malloc((scene->n_points + (size_t)1) * sizeof *z), eye[3];
    if (!z) return cn_fail(CN_ERR_NOMEM, "out of memory for the heights of %u points", scene->n_points);
    for (uint32_t i = 0; i < scene->n_points; i++)
        z[i] = scene->points[i].xyz[2];
    above[0] = above[1] = 0;
    above[2] = scene->n_points ? cn_select(z, scene->n_points, scene->n_points - 1 - scene->n_points / 200) : -INFINITY;
    free(z);
    for (uint32_t t = 0; t < survey->n_tiles; t++)
        for (int k = 0; k < 2; k++)
            above[k] += survey->tiles[t].centre[k] / survey->n_tiles;
    for (uint32_t v = 0; v < scene->n_views; v++) {
        cn_view_centre(&scene->views[v], eye);
        above[2] = fmax(above[2], eye[2]);
    }
    return CN_OK;
}

/* Splats beyond the tiles are the sky: a ray from above everything sees it. */
static bool aim_far(const job *j, size_t i, const double at[3])
{
    if (cn_distance3(at, j->centre) < CN_SPLAT_FAR * j->radius_m) return false;
    for (int k = 0; k < 3; k++)
        j->direction[i][k] = at[k] - j->above[k];
    memcpy(j->origin[i], j->above, sizeof j->above);
    return cn_normalize3(j->direction[i]);
}

/* The ray of splat i of the batch: from the photo that sees it largest. */
static void aim(void *user, size_t i, unsigned worker)
{
    const job *j = user;
    const uint32_t splat = j->which[j->first + i];
    const float *scale = j->splats->scale[splat];
    double at[3], normal[3], best = 0;
    (void)worker;
    axis_of(j->splats->rotation[splat], flattest(scale), normal);
    for (int k = 0; k < 3; k++) {
        at[k] = j->splats->origin[k] + (double)j->splats->centre[splat][k];
        j->direction[i][k] = normal[2] > 0 ? -normal[k] : normal[k];
    }
    if (aim_far(j, i, at)) return;
    double distance = 0;
    for (uint32_t v = 0; v < j->n_views; v++) {
        double eye[3], to[3];
        cn_view_centre(j->views[v], eye);
        for (int k = 0; k < 3; k++)
            to[k] = at[k] - eye[k];
        const double far = fmax(sqrt(to[0] * to[0] + to[1] * to[1] + to[2] * to[2]), 1e-9);
        const double score = (0.1 + fabs(to[0] * normal[0] + to[1] * normal[1] + to[2] * normal[2]) / far) / far;
        if (score <= best || !shows(j->l->survey->scene, j->views[v], at)) continue;
        best = score;
        distance = far;
        for (int k = 0; k < 3; k++)
            j->direction[i][k] = to[k] / far;
    }
    double before = j->near_m + BEFORE * (double)fmaxf(fmaxf(scale[0], scale[1]), scale[2]);
    if (distance > 0) before = fmin(before, distance);
    for (int k = 0; k < 3; k++)
        j->origin[i][k] = at[k] - before * j->direction[i][k];
}

/* The field's display-referred colours of the batch's rays under light l. */
static cn_status ask(job *j, const cn_tile *tile, uint32_t l, float (*out)[3])
{
    const cn_survey *survey = j->l->survey;
    cn_render_options options = survey->render;
    cn_appearance row;
    CN_TRY(cn_renderer_row(j->l->renderer, j->l->ctx, &j->l->specs[l], tile, &row));
    options.appearance = &row;
    const cn_ray_list rays = { j->n, (const double(*)[3])j->origin, (const double(*)[3])j->direction };
    CN_TRY(cn_render_rays(j->l->ctx, tile, &rays, &options, j->rgba[0], j->depth));
    for (uint32_t i = 0; i < j->n; i++) {
        j->fine[i] = (l == 0 || j->fine[i]) && j->rgba[i][3] >= MIN_ALPHA;
        for (int k = 0; k < 3; k++)
            out[i][k] = j->rgba[i][k] / fmaxf(j->rgba[i][3], 1e-6f);
    }
    const cn_display_transform display = { survey->view, survey->look, survey->exposure_ev };
    return cn_colour_to_display(survey->colour, &display, out[0], j->n, 3);
}

static uint8_t byte_of(double encoded)
{
    return (uint8_t)lround(fmin(fmax(encoded, 0), 1) * 255);
}

static double linear(double encoded)
{
    return cn_srgb_decode(fmin(fmax(encoded, 0), 1));
}

/* The splats of the batch under light l, whose field colours are in display. */
static void relight(const job *j, uint32_t l)
{
    const cn_splats *s = j->splats;
    const size_t row = (size_t)(s->degree + 1) * (s->degree + 1) * 3;
    for (uint32_t i = 0; i < j->n; i++) {
        const uint32_t splat = j->which[j->first + i];
        for (int k = 0; k < 3; k++) {
            const double fitted = 0.5 + 0.28209479177387814 * (double)s->colour[splat * row + (size_t)k];
            double light = linear(fitted);
            if (l && j->fine[i]) {
                const double ratio = (light + FLOOR) / (linear((double)j->own[i][k]) + FLOOR);
                light = linear((double)j->display[i][k]) * fmin(fmax(ratio, 1 / MOST_RATIO), MOST_RATIO);
            }
            j->colours[l][splat][k] = byte_of(l && j->fine[i] ? cn_srgb_encode(light) : fitted);
        }
    }
}

static cn_status take_batch(job *j, const cn_tile *tile)
{
    if (cn_stopping(j->l->ctx))
        return cn_fail(CN_ERR_INTERRUPTED, "stopped while asking for the splats' lights; run the same command again");
    if (j->l->n > 1) {
        cn_pool_run(j->l->ctx ? j->l->ctx->pool : NULL, j->n, aim, j);
        CN_TRY(ask(j, tile, 0, j->own));
    }
    for (uint32_t l = 0; l < j->l->n; l++) {
        if (l) CN_TRY(ask(j, tile, l, j->display));
        relight(j, l);
    }
    j->done += j->n;
    const double share = (double)j->done / (double)j->splats->n, elapsed = cn_now_s() - j->started;
    const cn_progress_report report = { "export", "lights", share,
                                        1,        elapsed,  share > 0 ? elapsed / share * (1 - share) : -1,
                                        NULL };
    cn_progress(j->l->ctx, &report);
    return CN_OK;
}

static void choose_tile(job *j, uint32_t tile)
{
    const cn_survey_tile *t = &j->l->survey->tiles[tile];
    memcpy(j->centre, t->centre, sizeof j->centre);
    j->radius_m = t->radius_m;
    j->n_views = t->n_views < MOST_VIEWS ? t->n_views : MOST_VIEWS;
    for (uint32_t i = 0; i < j->n_views; i++)
        j->views[i] = &j->l->survey->scene->views[t->views[(uint64_t)i * t->n_views / j->n_views]];
}

static uint32_t nearest_tile(const cn_survey *survey, const double at[3])
{
    uint32_t best = 0;
    double least = INFINITY;
    for (uint32_t t = 0; t < survey->n_tiles; t++) {
        const double off = hypot(survey->tiles[t].centre[0] - at[0], survey->tiles[t].centre[1] - at[1]);
        if (off < least) best = t;
        least = fmin(least, off);
    }
    return best;
}

/* Splats by the tile that is nearest: which[first[t]] .. which[first[t + 1]]. */
static cn_status group(job *j, uint32_t **first)
{
    const cn_survey *survey = j->l->survey;
    const cn_splats *s = j->splats;
    uint32_t *home = malloc((s->n + 1) * sizeof *home);
    *first = calloc(survey->n_tiles + (size_t)2, sizeof **first);
    j->which = malloc((s->n + 1) * sizeof *j->which);
    if (!home || !*first || !j->which) {
        free(home);
        return cn_fail(CN_ERR_NOMEM, "out of memory for the lights of %zu splats", s->n);
    }
    for (size_t i = 0; i < s->n; i++) {
        const double at[3] = { s->origin[0] + (double)s->centre[i][0], s->origin[1] + (double)s->centre[i][1], 0 };
        home[i] = nearest_tile(survey, at);
        (*first)[home[i] + 2]++;
    }
    for (uint32_t t = 2; t < survey->n_tiles + 2; t++)
        (*first)[t] += (*first)[t - 1];
    for (size_t i = 0; i < s->n; i++)
        j->which[(*first)[home[i] + 1]++] = (uint32_t)i;
    free(home);
    return CN_OK;
}

/* The open tile of the survey's tile t. */
static cn_status open_tile(const cn_splat_lights *l, uint32_t t, const cn_tile **tile)
{
    cn_tile_cache *cache = &l->renderer->tiles;
    for (uint32_t i = 0; i < cache->n; i++)
        if (strcmp(cache->plan->tiles[cache->which[i]].id, l->survey->tiles[t].id) == 0)
            return cn_tile_cache_tile(cache, cache->which[i], tile);
    return cn_fail(CN_ERR_DATA, "tile %s is gone; run the same command again", l->survey->tiles[t].id);
}

static cn_status take_all(job *j, const uint32_t *first)
{
    for (uint32_t t = 0; t < j->l->survey->n_tiles; t++) {
        const cn_tile *tile = NULL;
        if (first[t] == first[t + 1]) continue;
        CN_TRY(open_tile(j->l, t, &tile));
        choose_tile(j, t);
        j->near_m = tile->box.near_m * (1 + tile->box.step);
        for (j->first = first[t]; j->first < first[t + 1]; j->first += j->n) {
            j->n = first[t + 1] - j->first < BATCH ? first[t + 1] - j->first : BATCH;
            CN_TRY(take_batch(j, tile));
        }
    }
    return CN_OK;
}

static bool make_room(job *j, uint32_t n)
{
    j->origin = malloc(n * sizeof *j->origin);
    j->direction = malloc(n * sizeof *j->direction);
    j->rgba = malloc(n * sizeof *j->rgba);
    j->display = malloc(n * sizeof *j->display);
    j->own = malloc(n * sizeof *j->own);
    j->depth = malloc(n * sizeof *j->depth);
    j->fine = calloc(n, sizeof *j->fine);
    j->views = malloc(MOST_VIEWS * sizeof *j->views);
    return j->origin && j->direction && j->rgba && j->display && j->own && j->depth && j->fine && j->views;
}

static void free_room(job *j)
{
    free(j->origin);
    free(j->direction);
    free(j->rgba);
    free(j->display);
    free(j->own);
    free(j->depth);
    free(j->fine);
    free(j->views);
    free(j->which);
}

cn_status cn_splat_lights_find(const cn_splat_lights *lights, const cn_splats *splats, uint8_t (*const *colours)[3])
{
    job j = { .l = lights, .splats = splats, .colours = colours, .started = cn_now_s() };
    uint32_t *first = NULL;
    cn_status status = make_room(&j, BATCH) ? group(&j, &first) : cn_fail(CN_ERR_NOMEM, "out of memory for lights");
    if (status == CN_OK) status = place_above(lights->survey, j.above);
    if (status == CN_OK) status = take_all(&j, first);
    free(first);
    free_room(&j);
    return status;
}

/* ---- sky ---- */

static double elevation_of(uint32_t row)
{
    return 90 - (row + 0.5) * 180 / CN_SKY_HEIGHT;
}

/* From a place above everything in the middle. Rows below the horizon look as far up as the horizon's colour. */
static void aim_sky(job *j)
{
    for (uint32_t i = 0; i < j->n; i++) {
        const double up = cn_radians(fmax(elevation_of(i / CN_SKY_WIDTH), SKY_DEG));
        const double heading = cn_radians((i % CN_SKY_WIDTH + 0.5) * 360 / CN_SKY_WIDTH);
        const double direction[3] = { sin(heading) * cos(up), cos(heading) * cos(up), sin(up) };
        memcpy(j->origin[i], j->above, sizeof j->above);
        memcpy(j->direction[i], direction, sizeof direction);
    }
}

static void fill_sky(const job *j, uint8_t (*sky)[3])
{
    for (uint32_t i = 0; i < j->n; i++) {
        const double elevation = elevation_of(i / CN_SKY_WIDTH);
        const double known = fmin((double)j->rgba[i][3], 1) * fmin(fmax(1 + elevation / 30, 0), 1);
        for (int k = 0; k < 3; k++)
            sky[i][k] = byte_of(known * (double)j->display[i][k] + (1 - known) * 0.5);
    }
}

cn_status cn_splat_lights_sky(const cn_splat_lights *lights, uint8_t (*const *sky)[3])
{
    job j = { .l = lights, .n = CN_SKY_WIDTH * CN_SKY_HEIGHT };
    const cn_tile *tile = NULL;
    cn_status status = make_room(&j, j.n) ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the sky");
    if (status == CN_OK) status = place_above(lights->survey, j.above);
    if (status == CN_OK) status = open_tile(lights, nearest_tile(lights->survey, j.above), &tile);
    if (status == CN_OK) aim_sky(&j);
    for (uint32_t l = 0; l < lights->n && status == CN_OK; l++) {
        status = ask(&j, tile, l, j.display);
        if (status == CN_OK) fill_sky(&j, sky[l]);
    }
    free_room(&j);
    return status;
}
