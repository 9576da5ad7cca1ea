#include "surface/refine.h"

#include "math/linalg.h"
#include "stereo/stereo.h"
#include "surface/lattice.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    AT_ONCE = 32, /* maps that are refined together */
    MOST = 128,   /* photos that are read for them: the other ones are the nearest */
    ROUNDS = 2,
    FINE_ROUNDS = 1
};
#define WORST_COST 0.3f
/* So many of so many maps, those taken nearest, show the same place, or the depth is not moved. */
enum { NEIGHBOURS = 24, SUPPORT = 2 };
#define SAME 0.01        /* of the distance */
enum { REFUSED = 0x80 }; /* in a pixel's band, while maps are checked: the rendered depth comes back */
_Static_assert((int)CN_DEPTH_WIDEST < (int)REFUSED, "no band has this bit");

typedef struct refining {
    cn_depth_maps *maps;
    const cn_context *ctx;
    const cn_surface_source *source;
    uint32_t first, n; /* maps */
    uint32_t which[MOST], n_which;
    cn_stereo_map prior[AT_ONCE], found[AT_ONCE];
} refining;

#define MATCHED 0.9 /* part of the time */

/* Of a run of stereo, as part of the whole. */
static void report_matched(void *user, const cn_progress_report *report)
{
    const refining *r = user;
    const double done = MATCHED * (r->first + report->done) / r->maps->n;
    cn_progress(r->ctx, &(cn_progress_report){ .stage = "refine", .done = done, .total = 1, .left_s = -1 });
}

/* Views of the scene: those of the maps, then those that were taken nearest to them. */
static cn_status choose(refining *r)
{
    const cn_depth_maps *m = r->maps;
    r->n_which = m->n < MOST ? m->n : MOST;
    CN_TRY(cn_depth_maps_nearest(m, r->first, r->n, r->n_which, r->which));
    for (uint32_t i = 0; i < r->n_which; i++)
        r->which[i] = (uint32_t)(m->maps[r->which[i]].view - r->source->scene->views);
    return CN_OK;
}

/* What was rendered, along the camera's axis, at the size of the photo that is matched. */
static cn_status make_prior(const refining *r, const cn_depth_map *map, const cn_stereo_options *options,
                            cn_stereo_map *prior)
{
    if (map->view->photo >= cn_pixel_store_count(r->source->pixels)) return CN_OK;
    const cn_pixel_extent extent = cn_pixel_store_extent(r->source->pixels, map->view->photo);
    const uint32_t width = map->camera.width, height = map->camera.height;
    cn_stereo_size(options, extent.width, extent.height, &prior->width, &prior->height);
    prior->depth_m = calloc((size_t)prior->width * prior->height + 1, sizeof *prior->depth_m);
    if (!prior->depth_m) return cn_fail(CN_ERR_NOMEM, "out of memory for the depths of %s", map->view->name);
    for (uint32_t i = 0; i < prior->width * prior->height; i++) {
        const uint32_t x = (uint32_t)((i % prior->width + 0.5) * width / prior->width),
                       y = (uint32_t)((i / prior->width + 0.5) * height / prior->height);
        const cn_depth_pixel *pixel = r->maps->rendered + map->first + (size_t)y * width + x;
        double dir[3];
        if (pixel->band && isfinite(pixel->depth_m) &&
            cn_camera_unproject(&map->camera, x + 0.5, y + 0.5, dir) == CN_OK)
            prior->depth_m[i] = pixel->depth_m * (float)dir[2];
    }
    return CN_OK;
}

static void take(const refining *r, const cn_depth_map *map, const cn_stereo_map *found)
{
    const uint32_t width = map->camera.width, height = map->camera.height;
    cn_depth_pixel *pixels = r->maps->pixels + map->first;
    memcpy(pixels, r->maps->rendered + map->first, (size_t)width * height * sizeof *pixels);
    for (uint32_t i = 0; found->depth_m && i < width * height; i++) {
        double dir[3];
        /* Windows at a roof's edge see more of the roof than of the sky: that would give it a rim of sky. */
        if (pixels[i].band && isinf(pixels[i].depth_m)) continue;
        const float depth = cn_stereo_map_at(found, (i % width + 0.5) * found->width / width,
                                             (i / width + 0.5) * found->height / height);
        if (!(depth > 0) || cn_camera_unproject(&map->camera, i % width + 0.5, i / width + 0.5, dir) != CN_OK) continue;
        pixels[i].depth_m = depth / (float)dir[2];
        pixels[i].band = CN_LATTICE_BAND;
    }
}

static cn_status refine_some(refining *r)
{
    const cn_stereo_options options = { .width_px = r->source->width_px,
                                        .rounds = ROUNDS,
                                        .fine = FINE_ROUNDS,
                                        .sources = CN_STEREO_SOURCES,
                                        .worst_cost = WORST_COST };
    CN_TRY(choose(r));
    for (uint32_t i = 0; i < r->n; i++)
        CN_TRY(make_prior(r, &r->maps->maps[r->first + i], &options, &r->prior[i]));
    const cn_stereo_input input = { .scene = r->source->scene,
                                    .pixels = r->source->pixels,
                                    .views = r->which,
                                    .n = r->n_which,
                                    .prior = r->prior,
                                    .n_wanted = r->n };
    const cn_context ctx = { .progress = report_matched, .user = r, .stop = r->ctx->stop, .pool = r->ctx->pool };
    CN_TRY(cn_stereo_run(&ctx, &input, &options, r->found));
    for (uint32_t i = 0; i < r->n; i++)
        take(r, &r->maps->maps[r->first + i], &r->found[i]);
    return cn_depth_maps_keep(r->maps, r->first + r->n, false);
}

/* ---- what other maps do not support ---- */

typedef struct checking {
    const cn_depth_maps *maps;
    uint32_t map, nearest[1 + NEIGHBOURS], n_nearest, needed; /* nearest: the map itself, then the others */
} checking;

static void check_row(void *user, size_t row, unsigned worker)
{
    checking *c = user;
    const cn_depth_map *map = &c->maps->maps[c->map];
    const uint32_t width = map->camera.width;
    (void)worker;
    for (uint32_t x = 0; x < width; x++) {
        const size_t i = map->first + row * width + x;
        cn_depth_pixel *pixel = &c->maps->pixels[i];
        double away[3], xyz[3];
        if (!pixel->band || !isfinite(pixel->depth_m) || !cn_depth_pixel_moved(c->maps, pixel)) continue;
        if (!cn_depth_map_ray(map, x, (uint32_t)row, away)) continue;
        for (int k = 0; k < 3; k++)
            xyz[k] = map->centre[k] + (double)pixel->depth_m * away[k];
        uint32_t support = 0;
        for (uint32_t n = 1; n < c->n_nearest && support < c->needed; n++) {
            cn_depth_sight sight;
            support += cn_depth_map_look(c->maps, &c->maps->maps[c->nearest[n]], xyz, &sight) &&
                       fabs(sight.sight_m) < SAME * sight.distance_m;
        }
        pixel->band = (uint8_t)(support < c->needed ? pixel->band | REFUSED : pixel->band & ~REFUSED);
    }
}

/* A depth that was moved stays if enough other maps show the same place; else the rendered one comes back. All are
 * looked at before the first one is changed: the order does not matter. Marks lie in the file's pixels, since a byte
 * for each pixel of all photos may not fit into memory; a run that goes on sets them again. */
static cn_status check_all(cn_depth_maps *maps, const cn_context *ctx)
{
    checking c = { .maps = maps, .n_nearest = maps->n < 1 + NEIGHBOURS ? maps->n : 1 + NEIGHBOURS };
    c.needed = c.n_nearest - 1 < SUPPORT ? c.n_nearest - 1 : SUPPORT;
    cn_status status = CN_OK;
    for (; c.map < maps->n && status == CN_OK; c.map++) {
        status = cn_depth_maps_nearest(maps, c.map, 1, c.n_nearest, c.nearest);
        if (status != CN_OK) break;
        cn_pool_run(ctx->pool, maps->maps[c.map].camera.height, check_row, &c);
        const double done = MATCHED + (1 - MATCHED) * (c.map + 1) / maps->n;
        cn_progress(ctx, &(cn_progress_report){ .stage = "refine", .done = done, .total = 1, .left_s = -1 });
        if (cn_stopping(ctx))
            status = cn_fail(CN_ERR_INTERRUPTED, "stopped while making the mesh; run the same command again");
    }
    /* A run that is killed from here on leaves maps of which some are changed: they are then made again. */
    if (status == CN_OK) status = cn_depth_maps_keep(maps, 0, false);
    for (size_t i = 0; i < maps->n_pixels && status == CN_OK; i++)
        if (maps->pixels[i].band & REFUSED) maps->pixels[i] = maps->rendered[i];
    if (status == CN_OK) status = cn_depth_maps_keep(maps, maps->n, true);
    return status;
}

/* A depth may have moved beyond what was a map's largest. */
static void find_far(cn_depth_maps *maps)
{
    for (uint32_t m = 0; m < maps->n; m++) {
        cn_depth_map *map = &maps->maps[m];
        const cn_depth_pixel *pixels = maps->pixels + map->first;
        for (size_t i = 0; i < (size_t)map->camera.width * map->camera.height; i++)
            if (pixels[i].band) map->far_m = fmax(map->far_m, (double)pixels[i].depth_m);
    }
}

cn_status cn_depth_maps_refine(cn_depth_maps *maps, const cn_context *ctx, const cn_surface_source *source)
{
    refining r = { .maps = maps, .ctx = ctx, .source = source };
    cn_status status = CN_OK;
    for (r.first = maps->refined; r.first < maps->n && status == CN_OK; r.first += AT_ONCE) {
        r.n = maps->n - r.first < AT_ONCE ? maps->n - r.first : AT_ONCE;
        status = refine_some(&r);
        for (uint32_t i = 0; i < AT_ONCE; i++) {
            cn_stereo_map_deinit(&r.prior[i]);
            cn_stereo_map_deinit(&r.found[i]);
        }
    }
    if (status == CN_OK && !maps->checked) status = check_all(maps, ctx);
    if (status == CN_OK) find_far(maps);
    return status;
}
