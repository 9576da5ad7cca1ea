/* Overlapping tiles and the places that they share: the same as by a search of every pair and every point. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/rng.h"
#include "compose/overlap.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { TILES = 120, VIEWS = 600, POINTS = 4000, SEEN = 6, MOST = 50 };

typedef struct city {
    cn_camera camera;
    cn_view views[VIEWS];
    cn_point points[POINTS];
    cn_observation observations[POINTS * SEEN];
    cn_scene scene;
    uint32_t lists[TILES][VIEWS];
    cn_alignment_tile tiles[TILES];
    cn_alignment_input input;
} city;

static double at_random(uint32_t stream, uint32_t i, double most)
{
    return most * cn_rng_below(7, stream, i, 1000003) / 1000003;
}

/* A street of tiles, each with the views in its circle; a point is seen from around it. */
static void make(city *c)
{
    memset(c, 0, sizeof *c);
    c->camera = (cn_camera){ .lens = CN_LENS_PINHOLE, .width = 64, .height = 48, .params = { 50, 50, 32, 24 } };
    for (uint32_t v = 0; v < VIEWS; v++)
        c->views[v] = (cn_view){ .photo = v,
                                 .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 },
                                 .translation = { -(double)v, -at_random(1, v, 20), 0 } };
    for (uint32_t p = 0; p < POINTS; p++) {
        const uint32_t near = cn_rng_below(7, 2, p, VIEWS - 2 * SEEN);
        c->points[p] = (cn_point){ .xyz = { near, at_random(3, p, 20), 9 },
                                   .first_observation = p * SEEN,
                                   .n_observations = SEEN };
        for (uint32_t o = 0; o < SEEN; o++)
            c->observations[p * SEEN + o] = (cn_observation){ near + 2 * o, 30, 20 };
    }
    c->scene = (cn_scene){ .cameras = &c->camera,
                           .n_cameras = 1,
                           .views = c->views,
                           .n_views = VIEWS,
                           .points = c->points,
                           .n_points = POINTS,
                           .observations = c->observations,
                           .n_observations = POINTS * SEEN };
    for (uint32_t t = 0; t < TILES; t++) {
        cn_alignment_tile *tile = &c->tiles[t];
        *tile = (cn_alignment_tile){ .centre = { at_random(4, t, VIEWS), 10, 0 },
                                     .radius_m = t ? 5 + at_random(5, t, 25) : 200,
                                     .views = c->lists[t] };
        for (uint32_t v = 0; v < VIEWS; v++)
            if (fabs(tile->centre[0] - v) < tile->radius_m) c->lists[t][tile->n_views++] = v;
    }
    c->input = (cn_alignment_input){ .scene = &c->scene, .tiles = c->tiles, .n_tiles = TILES };
}

static uint32_t times_seen(const city *c, uint32_t point, uint32_t tile)
{
    uint32_t times = 0;
    for (uint32_t o = 0; o < SEEN; o++)
        for (uint32_t i = 0; i < c->tiles[tile].n_views; i++)
            times += c->lists[tile][i] == c->observations[point * SEEN + o].view;
    return times;
}

/* By every pair of tiles and, for each, every point. */
static void test_same_as_by_all_pairs(void **state)
{
    (void)state;
    city *c = malloc(sizeof *c);
    uint8_t *seen = calloc(TILES, POINTS);
    cn_alignment_edge *edges;
    uint32_t n, at = 0;
    cn_places places;
    assert_true(c && seen);
    make(c);
    for (uint32_t t = 0; t < TILES; t++)
        for (uint32_t p = 0; p < POINTS; p++)
            seen[t * POINTS + p] = (uint8_t)times_seen(c, p, t);
    assert_int_equal(cn_overlap_find(&c->input, &edges, &n), CN_OK);
    assert_int_equal(cn_places_init(&places, MOST), CN_OK);
    for (uint32_t a = 0; a < TILES; a++)
        for (uint32_t b = a + 1; b < TILES; b++) {
            const cn_alignment_tile *x = &c->tiles[a], *y = &c->tiles[b];
            uint32_t shared = 0;
            for (uint32_t p = 0; p < POINTS; p++)
                shared += seen[a * POINTS + p] >= 2 && seen[b * POINTS + p] >= 2;
            const bool near = fabs(x->centre[0] - y->centre[0]) < x->radius_m + y->radius_m;
            if (!near || shared < CN_PLACES_MIN) continue;
            assert_true(at < n && edges[at].a == a && edges[at].b == b);
            assert_int_equal(edges[at++].n_places, shared);
            /* The rays run to points that both see, in their order. */
            places.n = 0;
            assert_int_equal(cn_places_add(&places, &c->input, a, b, MOST), CN_OK);
            assert_int_equal(places.n, MOST);
            for (uint32_t p = 0, i = 0, count = 0; p < POINTS && i < MOST; p++) {
                if (seen[a * POINTS + p] < 2 || seen[b * POINTS + p] < 2) continue;
                const uint32_t wanted = shared < MOST ? shared : MOST;
                if (count++ * wanted / shared < i) continue;
                if (i == wanted) break;
                double to[3], along = 0, length = 0;
                for (int k = 0; k < 3; k++) {
                    to[k] = c->points[p].xyz[k] - places.origin[i][k];
                    along += to[k] * places.direction[i][k];
                    length += to[k] * to[k];
                }
                assert_true(fabs(along - sqrt(length)) < 1e-9 * along);
                i++;
            }
        }
    assert_int_equal(at, n);
    assert_true(n > TILES);
    cn_places_deinit(&places);
    free(edges);
    free(seen);
    free(c);
}

/* A hundred thousand tiles in a row, one of them as long as the whole. A search of every pair would take minutes. */
static void test_many_tiles(void **state)
{
    (void)state;
    enum { MANY = 100000 };
    cn_alignment_tile *tiles = calloc(MANY, sizeof *tiles);
    const cn_scene scene = { 0 };
    cn_alignment_edge *edges;
    uint32_t n;
    assert_non_null(tiles);
    for (uint32_t t = 0; t < MANY; t++)
        tiles[t] = (cn_alignment_tile){ .centre = { 7, 10.0 * t, 0 }, .radius_m = t == 5 ? 1e6 : 6 };
    const cn_alignment_input input = { .scene = &scene, .tiles = tiles, .n_tiles = MANY };
    assert_int_equal(cn_overlap_find(&input, &edges, &n), CN_OK);
    assert_int_equal(n, 0); /* none of them shares a photo */
    free(edges);
    free(tiles);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_same_as_by_all_pairs),
                                        cmocka_unit_test(test_many_tiles) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
