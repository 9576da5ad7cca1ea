/* Tiles that share space: parts of unity, one march that equals a tile's own, and what it costs. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../common.h"
#include "block.h"

#include "base/file.h"
#include "conurb/compose.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SIDE = 64, WEST, EAST, BLIND, SEEING, TILES };
static char folder[] = "/tmp/conurb-union-XXXXXX";
static cn_tile *tiles[TILES];
static const cn_context ctx = { 0 };
static const cn_camera camera = {
    .lens = CN_LENS_PINHOLE, .width = SIDE, .height = SIDE, .params = { 64, 64, 32, 32 }
};

/* Photos show matter in every direction, 4 m away. Those of one tile saw no place, those of the other all. */
static uint32_t no_place[CN_SEEN_PLACES / 32], all_places[CN_SEEN_PLACES / 32];
static uint8_t matter[CN_SEEN_DIRECTIONS];
static float distance[CN_SEEN_DIRECTIONS];
static const cn_seen blind = { no_place, matter, distance, NULL }, seeing = { all_places, matter, distance, NULL };

static int make(void **state)
{
    (void)state;
    memset(all_places, 0xff, sizeof all_places);
    memset(matter, 0xff, sizeof matter);
    for (uint32_t i = 0; i < CN_SEEN_DIRECTIONS; i++)
        distance[i] = 4;
    const block blocks[TILES] = { [WEST] = { .id = "west", .x = -4, .rgb = { 0.8f, 0.1f, 0.1f } },
                                  [EAST] = { .id = "east", .x = 4, .rgb = { 0.1f, 0.7f, 0.1f } },
                                  [BLIND] = { .id = "blind", .rgb = { 0.8f, 0.1f, 0.1f }, .seen = &blind },
                                  [SEEING] = { .id = "seeing", .rgb = { 0.8f, 0.1f, 0.1f }, .seen = &seeing } };
    if (!mkdtemp(folder)) return -1;
    for (int i = WEST; i < TILES; i++) {
        char *path = cn_path_join(folder, blocks[i].id);
        assert_int_equal(block_write(&blocks[i], path), CN_OK);
        assert_int_equal(cn_tile_open(&tiles[i], path), CN_OK);
        free(path);
    }
    return 0;
}

static int unmake(void **state)
{
    (void)state;
    for (int i = WEST; i < TILES; i++)
        cn_tile_close(&tiles[i]);
    return folder_remove(folder);
}

static cn_union_part part(const cn_tile *tile, double x)
{
    return (cn_union_part){ .tile = tile, .centre_m = { x, 0, 0 }, .blend_width_m = 1 };
}

static void parts_sum_to_one(void **state)
{
    (void)state;
    cn_union_part p[3] = { part(NULL, -4), part(NULL, 4), part(NULL, 5) };
    p[2].centre_m[1] = 7;
    double share[3];
    for (int i = 0; i < 2000; i++) {
        const double xy[2] = { -12 + 0.012 * i, 6 * sin(0.05 * i) };
        cn_union_shares(3, p, xy, share);
        assert_true(fabs(share[0] + share[1] + share[2] - 1) < 1e-5);
    }
    cn_union_shares(2, p, (double[]){ 0, 3 }, share);
    assert_true(fabs(share[0] - 0.5) < 1e-6);
    cn_union_shares(2, p, (double[]){ -4, 0 }, share);
    assert_true(share[0] == 1 && share[1] == 0);
    cn_union_shares(2, p, (double[]){ -0.51, 0 }, share); /* past the band: the distances differ by more than a metre */
    assert_true(share[0] == 1);
    cn_union_shares(2, p, (double[]){ -0.25, 0 }, share);
    assert_true(share[0] > 0.6 && share[0] < 1);
    p[0].offset_m = 3; /* it recedes by half of that */
    cn_union_shares(2, p, (double[]){ -1.5, 0 }, share);
    assert_true(fabs(share[0] - 0.5) < 1e-5);
    p[0].offset_m = INFINITY;
    cn_union_shares(2, p, (double[]){ -4, 0 }, share);
    assert_true(share[0] == 0 && share[1] == 1);
}

static cn_picture render(uint32_t n, const cn_union_part *parts, const cn_view *view, float *border, uint32_t *owner)
{
    const cn_render_options options = cn_render_options_default();
    cn_picture picture;
    assert_int_equal(cn_picture_init(&picture, SIDE, SIDE), CN_OK);
    assert_int_equal(cn_render_union(&ctx, &(cn_union){ n, parts }, &camera, view, &options,
                                     &(cn_union_output){ .picture = &picture, .border = border, .owner = owner }),
                     CN_OK);
    return picture;
}

static cn_picture render_alone(const cn_tile *tile, const cn_view *view)
{
    const cn_render_options options = cn_render_options_default();
    cn_picture picture;
    assert_int_equal(cn_picture_init(&picture, SIDE, SIDE), CN_OK);
    assert_int_equal(cn_render_tile(&ctx, tile, &camera, view, &options, &picture), CN_OK);
    return picture;
}

static void assert_same(cn_picture a, cn_picture b, float tolerance)
{
    float most = 0;
    for (size_t i = 0; i < SIDE * SIDE * 4; i++)
        most = fmaxf(most, fabsf(a.rgba[i] - b.rgba[i]));
    for (size_t i = 0; i < SIDE * SIDE; i++)
        most = fmaxf(most, 0.1f * fabsf(a.depth[i] - b.depth[i]));
    assert_true(most < tolerance);
    cn_picture_deinit(&a);
    cn_picture_deinit(&b);
}

/* A view that leaves the tile's box on one side, so that there is nothing in some pixels. */
static void one_tile_is_itself(void **state)
{
    (void)state;
    cn_view view;
    block_look_down(-10, 2, 9, &view);
    const cn_union_part p = part(tiles[WEST], -4);
    const cn_picture alone = render_alone(tiles[WEST], &view);
    assert_true(alone.rgba[4 * (SIDE * SIDE / 2) + 3] == 0 && alone.rgba[4 * (SIDE * SIDE / 2 + SIDE - 1) + 3] > 0.99f);
    static uint32_t owner[SIDE * SIDE];
    const cn_picture same = render(1, &p, &view, NULL, owner);
    assert_true(owner[SIDE * SIDE / 2] == UINT32_MAX && owner[SIDE * SIDE / 2 + SIDE - 1] == 0);
    assert_memory_equal(same.rgba, alone.rgba, SIDE * SIDE * 4 * sizeof(float)); /* one march makes both */
    assert_memory_equal(same.depth, alone.depth, SIDE * SIDE * sizeof(float));
    assert_same(same, alone, 2e-3f);
}

/* Without depth_left the depth is the mean, also where a ray ends at an opaque surface. */
static void depth_is_the_mean(void **state)
{
    (void)state;
    cn_view view;
    cn_render_options options = cn_render_options_default();
    options.depth_left = 0;
    cn_picture mean, whole;
    block_look_down(-4, 1, 7, &view);
    assert_int_equal(cn_picture_init(&mean, SIDE, SIDE), CN_OK);
    assert_int_equal(cn_picture_init(&whole, SIDE, SIDE), CN_OK);
    assert_int_equal(cn_render_tile(&ctx, tiles[WEST], &camera, &view, &options, &mean), CN_OK);
    options.min_transmittance = 0;
    assert_int_equal(cn_render_tile(&ctx, tiles[WEST], &camera, &view, &options, &whole), CN_OK);
    assert_same(mean, whole, 2e-3f);
}

/* The mean of depth over true distance, less 1, of flat ground seen from 7 m above, each pixel along its own ray. */
static double bias_of_depth(const cn_render_options *options)
{
    cn_view view;
    cn_picture p;
    double sum = 0;
    block_look_down(-4, 1, 7, &view);
    assert_int_equal(cn_picture_init(&p, SIDE, SIDE), CN_OK);
    assert_int_equal(cn_render_tile(&ctx, tiles[WEST], &camera, &view, options, &p), CN_OK);
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        const double x = (i % SIDE + 0.5 - 32) / 64, y = (i / SIDE + 0.5 - 32) / 64, z = sqrt(x * x + y * y + 1);
        sum += (double)p.depth[i] / (7 * z) - 1;
    }
    cn_picture_deinit(&p);
    return sum / (SIDE * SIDE);
}

/* A step is 1/256 of the distance. With a density of 50 in a metre its optical depth is 1.4 to 1.7, so the first step
 * in matter takes more than half of the light, on average at 0.37 to 0.39 of the step. */
static void depth_is_at_the_surface(void **state)
{
    (void)state;
    cn_render_options options = cn_render_options_default();
    const double fine = bias_of_depth(&options);
    options.fine_depth = false;
    const double middle = bias_of_depth(&options);
    print_message("bias of depth: %.5f, by the middle of steps %.5f\n", fine, middle);
    assert_true(fabs(fine - 0.38 / 256) < 0.0001);
    assert_true(fabs(middle - 0.5 / 256) < 0.0001);
}

/* The same tile as two parts of a union: what each owns adds up to the whole, in the band too. */
static void a_tile_and_itself_are_itself(void **state)
{
    (void)state;
    cn_view view;
    block_look_down(-4, 1, 7, &view);
    const cn_union_part p[2] = { part(tiles[WEST], -5.1), part(tiles[WEST], -2.9) };
    assert_same(render(2, p, &view, NULL, NULL), render_alone(tiles[WEST], &view), 2e-3f);
}

static void places_belong_to_the_nearest(void **state)
{
    (void)state;
    static float border[SIDE * SIDE];
    static uint32_t owner[SIDE * SIDE];
    cn_view view;
    block_look_down(0, 0, 8, &view);
    const cn_union_part p[2] = { part(tiles[WEST], -4), part(tiles[EAST], 4) };
    cn_picture picture = render(2, p, &view, border, owner);
    for (uint32_t x = 0; x < SIDE; x++) {
        const uint32_t i = SIDE / 2 * SIDE + x;
        const double east_m = (x + 0.5 - 32) / 64 * 8;
        const float *rgb = picture.rgba + 4 * (size_t)i;
        assert_true(fabsf(rgb[3] - 1) < 2e-3f);
        assert_true(fabs((double)picture.depth[i] / hypot(8, east_m) * 8 - 8) <
                    2 * BLOCK_CELL); /* no step between the tiles */
        if (east_m < -0.6) assert_true(fabsf(rgb[0] - 0.8f) < 0.01f && border[i] == 0);
        if (east_m > 0.6) assert_true(fabsf(rgb[1] - 0.7f) < 0.01f && border[i] == 0);
        if (fabs(east_m) > 0.1) assert_true(owner[i] == (east_m > 0));
        if (fabs(east_m) < 0.1) assert_true(rgb[0] > 0.25f && rgb[1] > 0.25f && border[i] > 0.3f);
    }
    cn_picture_deinit(&picture);
}

static void too_many_or_none_are_refused(void **state)
{
    (void)state;
    const cn_render_options options = cn_render_options_default();
    cn_picture picture = { .width = SIDE, .height = SIDE };
    cn_view view;
    block_look_down(0, 0, 8, &view);
    assert_int_equal(cn_render_union(&ctx, &(cn_union){ 0, NULL }, &camera, &view, &options,
                                     &(cn_union_output){ .picture = &picture }),
                     CN_ERR_USAGE);
    assert_int_equal(cn_render_union(&ctx, &(cn_union){ CN_UNION_MAX + 1, NULL }, &camera, &view, &options,
                                     &(cn_union_output){ .picture = &picture }),
                     CN_ERR_USAGE);
    picture.width = 1;
    assert_int_equal(cn_render_union(&ctx, &(cn_union){ 1, NULL }, &camera, &view, &options,
                                     &(cn_union_output){ .picture = &picture }),
                     CN_ERR_USAGE);
}

/* A camera to the left of the only tile sees the ground on its right half. */
static void visibility_counts_what_is_in_the_box(void **state)
{
    (void)state;
    cn_view view;
    double seen;
    block_look_down(-4, 0, 7, &view);
    assert_int_equal(cn_compose_visibility(&ctx, tiles[WEST], &camera, &view, &seen), CN_OK);
    assert_true(seen > 0.99);
    block_look_down(-12, 0, 7, &view);
    assert_int_equal(cn_compose_visibility(&ctx, tiles[WEST], &camera, &view, &seen), CN_OK);
    assert_true(seen > 0.45 && seen < 0.55);
    view = (cn_view){ .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 }, .translation = { 4, 0, -2 } }; /* up */
    assert_int_equal(cn_compose_visibility(&ctx, tiles[WEST], &camera, &view, &seen), CN_OK);
    assert_true(seen == 0);
}

/* To the west, 2 m above the ground: the ground below, and above the horizon a sky of light 1, or a wall that no photo
 * saw. What one tile's photos saw is enough. */
static void a_wall_that_no_photo_saw_is_no_sky(void **state)
{
    (void)state;
    const cn_view west = { .rotation = { 0, 1, 0, 0, 0, -1, -1, 0, 0 }, .translation = { 0, 2, 0 } };
    const cn_union_part both[2] = { part(tiles[BLIND], -4), part(tiles[SEEING], 4) };
    cn_picture open = render_alone(tiles[SEEING], &west), hidden = render_alone(tiles[BLIND], &west),
               shared = render(2, both, &west, NULL, NULL);
    const size_t above = 10 * SIDE + 32, ground = 50 * SIDE + 32;
    for (size_t c = 0; c < 4; c++) {
        assert_true(fabsf(open.rgba[4 * above + c] - 1) < 1e-4f && fabsf(shared.rgba[4 * above + c] - 1) < 1e-4f);
        assert_true(hidden.rgba[4 * above + c] == 0);
        assert_true(fabsf(open.rgba[4 * ground + c] - hidden.rgba[4 * ground + c]) < 1e-4f);
    }
    assert_true(open.depth[above] == 0 && hidden.depth[above] == 0 && hidden.depth[ground] > 0);
    assert_true(hidden.rgba[4 * ground + 3] > 0.99f);
    assert_int_equal(cn_compose_unseen(&hidden, CN_UNSEEN_FILL), CN_OK);
    assert_true(hidden.rgba[4 * above] > 3 * hidden.rgba[4 * above + 1]); /* red, as the ground is */
    cn_picture_deinit(&open);
    cn_picture_deinit(&hidden);
    cn_picture_deinit(&shared);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(parts_sum_to_one),
        cmocka_unit_test(one_tile_is_itself),
        cmocka_unit_test(depth_is_the_mean),
        cmocka_unit_test(depth_is_at_the_surface),
        cmocka_unit_test(a_tile_and_itself_are_itself),
        cmocka_unit_test(places_belong_to_the_nearest),
        cmocka_unit_test(too_many_or_none_are_refused),
        cmocka_unit_test(visibility_counts_what_is_in_the_box),
        cmocka_unit_test(a_wall_that_no_photo_saw_is_no_sky),
    };
    return cmocka_run_group_tests(tests, make, unmake);
}
