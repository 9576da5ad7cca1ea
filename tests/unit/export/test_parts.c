#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/rng.h"
#include "export/blocks.h"
#include "export/cubes.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void a_cube_holds_one_point(void **state)
{
    (void)state;
    cn_cubes cubes;
    bool fresh;
    cn_cubes_init(&cubes, 0.5);
    const double a[3] = { 0.1, 0.1, 0.1 }, b[3] = { 0.4, 0.2, 0.3 }, c[3] = { -0.1, 0.1, 0.1 };
    assert_int_equal(cn_cubes_add(&cubes, a, &fresh), CN_OK);
    assert_true(fresh);
    assert_int_equal(cn_cubes_add(&cubes, b, &fresh), CN_OK);
    assert_false(fresh);
    assert_int_equal(cn_cubes_add(&cubes, c, &fresh), CN_OK); /* the other side of nothing is another cube */
    assert_true(fresh);
    /* Many: every cube of a block once, in any order, each twice. */
    size_t n = 0;
    for (uint64_t i = 0; i < 60000; i++) {
        const uint64_t k = cn_rng_mix(i % 30000) % 27000;
        const double p[3] = { 100 + 0.5 * (double)(k % 30), 0.5 * (double)(k / 30 % 30), -0.5 * (double)(k / 900) };
        assert_int_equal(cn_cubes_add(&cubes, p, &fresh), CN_OK);
        n += fresh;
    }
    assert_int_equal(n + 2, cubes.taken.n);
    assert_true(n > 17000 && n < 19000); /* 27000 (1 - exp(-30/27)) are met */
    cn_cubes_deinit(&cubes);
}

static void sums_come_back(void **state)
{
    (void)state;
    cn_blocks blocks;
    cn_pixel_sum *sums = malloc(sizeof(cn_block_sums)), *back = malloc(sizeof(cn_block_sums));
    assert_int_equal(cn_blocks_open(&blocks, "/tmp/any.tif", 3, 2), CN_OK);
    assert_int_equal(cn_blocks_read(&blocks, 2, 1, back), CN_OK);
    assert_true(back[CN_BLOCK * CN_BLOCK - 1].weight == 0);
    for (int i = 0; i < CN_BLOCK * CN_BLOCK; i++)
        sums[i] = (cn_pixel_sum){ { 1, 2, 3 }, 4, (float)i, 6 };
    assert_int_equal(cn_blocks_write(&blocks, 1, 1, sums), CN_OK);
    assert_int_equal(cn_blocks_read(&blocks, 1, 1, back), CN_OK);
    assert_memory_equal(sums, back, sizeof(cn_block_sums));
    assert_int_equal(cn_blocks_read(&blocks, 0, 1, back), CN_OK);
    assert_true(back[0].weight == 0);
    cn_blocks_close(&blocks);
    cn_blocks_close(&blocks);
    assert_int_equal(cn_blocks_open(&blocks, "/nonexistent/any.tif", 3, 2), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), "/nonexistent"));
    cn_blocks_close(&blocks);
    free(sums);
    free(back);
}

/* Pixels of a grid, seen as places on Earth, are where the projection says, and their lines are plumb. */
static void a_grid_is_where_it_says(void **state)
{
    (void)state;
    cn_frame frame;
    cn_frame_init(&frame);
    frame.georeferenced = true;
    frame.latitude_deg = -33.86; /* Sydney: south, far from the middle of its zone */
    frame.longitude_deg = 151.21;
    frame.height_m = 60;
    const cn_survey_tile tiles[2] = { { .centre = { 0, 0, 0 }, .radius_m = 50 },
                                      { .centre = { 400, 100, 0 }, .radius_m = 50 } };
    const cn_survey survey = { .frame = &frame, .tiles = tiles, .n_tiles = 2, .reach = 2 };
    const cn_height_sampler sampler = { .survey = &survey, .top_m = 30 };
    cn_ground_grid grid;
    cn_height_samples q;
    assert_int_equal(cn_ground_grid_init(&grid, &sampler, 0.5), CN_OK);
    assert_int_equal(cn_height_samples_init(&q, CN_BLOCK * CN_BLOCK), CN_OK);
    assert_int_equal(grid.projection.epsg, 32756);
    assert_true(fabs(remainder(grid.left_m, 0.5)) < 1e-9 && fabs(remainder(grid.north_m, 0.5)) < 1e-9);
    assert_true(grid.across * CN_BLOCK * 0.5 >= 600 && grid.across * CN_BLOCK * 0.5 < 600 + 60);
    cn_block_range range;
    assert_int_equal(cn_ground_grid_range(&grid, &tiles[0], 2, &range), CN_OK);
    assert_true(range.x0 == 0 && range.x1 <= 8 && range.y1 == grid.down);
    assert_int_equal(cn_ground_grid_block(&grid, grid.across - 1, 1, &q), CN_OK);
    for (size_t i = 0; i < q.n; i += 777) {
        double place[3], below[3], local[3];
        assert_int_equal(cn_frame_to_geodetic(&frame, q.top[i], place), CN_OK);
        assert_true(fabs(place[2] - 90) < 1e-4); /* one height above the ellipsoid, however far from the origin */
        for (int k = 0; k < 3; k++)
            local[k] = q.top[i][k] + 50 * q.down[i][k];
        assert_int_equal(cn_frame_to_geodetic(&frame, local, below), CN_OK);
        assert_true(fabs(below[2] - 40) < 1e-4 && fabs(below[0] - place[0]) < 1e-9 && fabs(below[1] - place[1]) < 1e-9);
    }
    /* A step of one pixel is half a metre by the projection's scale, and east is not quite the local east. */
    const double *a = q.top[0], *b = q.top[CN_BLOCK - 1];
    assert_true(fabs(hypot(b[0] - a[0], b[1] - a[1]) - 0.5 * (CN_BLOCK - 1)) < 0.5 * CN_BLOCK * 1e-3);
    assert_true(fabs(b[1] - a[1]) > 0.05);
    assert_true(fabs(cn_ground_grid_height(&grid, 12.5) - (60 + 30 - 12.5)) < 1e-9);
    cn_height_samples_deinit(&q);
    cn_ground_grid_deinit(&grid);
    assert_int_equal(cn_ground_grid_init(&grid, &sampler, 0), CN_ERR_USAGE);
    cn_ground_grid_deinit(&grid);
    assert_int_equal(cn_ground_grid_init(&grid, &sampler, 0.0002), CN_ERR_USAGE);
    assert_non_null(strstr(cn_error_message(), "--gsd"));
    cn_ground_grid_deinit(&grid);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_cube_holds_one_point),
        cmocka_unit_test(sums_come_back),
        cmocka_unit_test(a_grid_is_where_it_says),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
