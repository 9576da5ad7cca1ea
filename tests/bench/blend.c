/* Compares the cost of a blended view with that of one tile's render. Measures the processor time of each scheme over
 * the city's own views, and that of ownership by the two tiles nearest to a view against each of the two alone. Takes
 * medians. The schemes take turns, so that other programs disturb all of them alike. usage: bench_blend CITY [ROUNDS]
 * [WIDTH]        exit code 1 when ownership by two costs more than LIMIT renders of one */
#include "base/clock.h"
#include "conurb/base.h"
#include "renderer/tile_cache.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LIMIT 1.2
enum { VIEWS = 12, MOST_ROUNDS = 99 };

typedef struct bench {
    cn_context ctx;
    cn_dataset m;
    cn_tile_cache tiles;
    cn_picture picture;
    uint32_t rounds, width;
} bench;

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *x, uint32_t n)
{
    qsort(x, n, sizeof *x, compare);
    return n % 2 ? x[n / 2] : (x[n / 2 - 1] + x[n / 2]) / 2;
}

/* View i of VIEWS, evenly from the scene, at the bench's width. */
static cn_status take_view(bench *b, uint32_t i, cn_camera *camera, const cn_view **view)
{
    const cn_scene *s = &b->m.scene;
    const uint32_t n = s->n_views < VIEWS ? s->n_views : VIEWS;
    *view = &s->views[(uint64_t)i * s->n_views / n];
    const cn_camera *c = &s->cameras[(*view)->camera];
    const uint32_t height = (uint32_t)fmax(1, round((double)c->height * b->width / c->width));
    cn_camera_resize(c, b->width, height, camera);
    if (b->picture.width == b->width && b->picture.height == height) return CN_OK;
    cn_picture_deinit(&b->picture);
    return cn_picture_init(&b->picture, b->width, height);
}

/* For each scheme over the views: the median of the rounds. */
static cn_status schemes(bench *b, uint32_t n_views)
{
    static double took[CN_BLEND_OWNERSHIP + 1][MOST_ROUNDS * VIEWS];
    cn_camera camera;
    const cn_view *view;
    const cn_render_options options = cn_render_options_default();
    uint32_t n = 0;
    for (uint32_t r = 0; r < b->rounds; r++)
        for (uint32_t v = 0; v < n_views; v++, n++)
            for (int scheme = 0; scheme <= CN_BLEND_OWNERSHIP; scheme++) {
                CN_TRY(take_view(b, v, &camera, &view));
                b->tiles.compose.scheme = (cn_blend)scheme;
                const cn_tile_cache_view asked = { .camera = &camera, .view = view, .options = &options };
                const double started = cn_clock_s(CLOCK_PROCESS_CPUTIME_ID);
                CN_TRY(cn_tile_cache_blend(&b->tiles, &b->ctx, &asked, &b->picture));
                took[scheme][n] = cn_clock_s(CLOCK_PROCESS_CPUTIME_ID) - started;
            }
    printf("%u views of %u px, %u rounds: median processor seconds a picture\n", n_views, b->width, b->rounds);
    for (int scheme = 0; scheme <= CN_BLEND_OWNERSHIP; scheme++)
        printf("  %-12s %.3f\n", cn_blend_name((cn_blend)scheme), median(took[scheme], n));
    return CN_OK;
}

/* The two tiles whose centres are nearest. */
static void nearest_two(const cn_tile_cache *g, const cn_view *view, uint32_t two[2])
{
    double centre[3], least[2] = { INFINITY, INFINITY };
    cn_view_centre(view, centre);
    for (uint32_t i = 0; i < g->n; i++) {
        const double d = hypot(g->centres[i][0] - centre[0], g->centres[i][1] - centre[1]);
        if (d < least[0])
            least[1] = least[0], two[1] = two[0], least[0] = d, two[0] = i;
        else if (d < least[1])
            least[1] = d, two[1] = i;
    }
}

/* Renders one view by each tile of parts alone (seconds of each), and as a union. */
static cn_status time_view(bench *b, const cn_union_part parts[2], const cn_camera *camera, const cn_view *view,
                           double took[3])
{
    const cn_render_options options = cn_render_options_default();
    double started;
    for (int k = 0; k < 2; k++) {
        started = cn_clock_s(CLOCK_PROCESS_CPUTIME_ID);
        CN_TRY(cn_render_tile(&b->ctx, parts[k].tile, camera, view, &options, &b->picture));
        took[k] = cn_clock_s(CLOCK_PROCESS_CPUTIME_ID) - started;
    }
    started = cn_clock_s(CLOCK_PROCESS_CPUTIME_ID);
    CN_TRY(cn_render_union(&b->ctx, &(cn_union){ 2, parts }, camera, view, &options,
                           &(cn_union_output){ .picture = &b->picture }));
    took[2] = cn_clock_s(CLOCK_PROCESS_CPUTIME_ID) - started;
    return CN_OK;
}

static cn_status two_overlap(bench *b, uint32_t n_views, double *ratio)
{
    static double ratios[VIEWS * MOST_ROUNDS];
    cn_camera camera;
    const cn_view *view;
    uint32_t n = 0;
    for (uint32_t v = 0; v < n_views; v++) {
        uint32_t two[2];
        cn_union_part parts[2] = { 0 };
        CN_TRY(take_view(b, v, &camera, &view));
        nearest_two(&b->tiles, view, two);
        for (int k = 0; k < 2; k++) {
            CN_TRY(cn_tile_cache_tile(&b->tiles, b->tiles.which[two[k]], &parts[k].tile));
            memcpy(parts[k].centre_m, b->tiles.centres[two[k]], sizeof parts[k].centre_m);
            parts[k].blend_width_m = CN_TILE_CACHE_BLEND_WIDTH * b->tiles.radii[two[k]];
        }
        for (uint32_t r = 0; r < b->rounds; r++) {
            double took[3];
            CN_TRY(time_view(b, parts, &camera, view, took));
            ratios[n++] = took[2] / ((took[0] + took[1]) / 2);
        }
    }
    *ratio = median(ratios, n);
    printf("ownership by the two tiles nearest to a view: %.3f renders of one of them (median of %u; bar %.1f), %.3f "
           "to %.3f\n",
           *ratio, n, LIMIT, ratios[n / 10], ratios[n - 1 - n / 10]);
    return CN_OK;
}

static cn_status run(const char *folder, bench *b, double *ratio)
{
    cn_city *city;
    CN_TRY(cn_city_open(&city, folder));
    cn_status status = cn_dataset_load(&b->ctx, city, true, &b->m);
    if (status == CN_OK) status = cn_tile_cache_init(&b->tiles, &b->ctx, city, &b->m);
    if (status == CN_OK && b->tiles.n < 2)
        status = cn_fail(CN_ERR_DATA, "%s has a single tile; two have to overlap", folder);
    const uint32_t n_views = b->m.scene.n_views < VIEWS ? b->m.scene.n_views : VIEWS;
    if (status == CN_OK) status = schemes(b, n_views);
    if (status == CN_OK) status = two_overlap(b, n_views, ratio);
    cn_picture_deinit(&b->picture);
    cn_tile_cache_deinit(&b->tiles);
    cn_dataset_deinit(&b->m);
    cn_city_close(&city);
    return status;
}

int main(int argc, char **argv)
{
    bench b = { .rounds = argc > 2 ? (uint32_t)atoi(argv[2]) : 5, .width = argc > 3 ? (uint32_t)atoi(argv[3]) : 480 };
    double ratio = 0;
    if (argc < 2 || b.rounds < 1 || b.rounds > MOST_ROUNDS || b.width < 16) {
        fprintf(stderr, "usage: bench_blend CITY [ROUNDS] [WIDTH]\n");
        return 2;
    }
    cn_status status = cn_pool_create(&b.ctx.pool, 0);
    if (status == CN_OK) status = run(argv[1], &b, &ratio);
    cn_pool_destroy(&b.ctx.pool);
    if (status != CN_OK) fprintf(stderr, "bench_blend: %s\n", cn_error_message());
    return status != CN_OK ? 2 : ratio > LIMIT;
}
