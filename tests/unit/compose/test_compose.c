#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "conurb/compose.h"

#include <math.h>
#include <string.h>

#define assert_near(value, want, tolerance) assert_true(fabs((double)(value) - (want)) <= (tolerance))

static void check_weights(uint32_t n, const double *distance, double exponent, const double *want)
{
    double weight[8];
    cn_compose_weights(n, distance, exponent, weight);
    for (uint32_t i = 0; i < n; i++) assert_near(weight[i], want[i], 1e-12);
}

static void weights_follow_the_power(void **state)
{
    (void)state;
    check_weights(2, (double[]){10, 20}, 1, (double[]){2.0 / 3, 1.0 / 3});
    check_weights(2, (double[]){10, 20}, 4, (double[]){16.0 / 17, 1.0 / 17});
    check_weights(3, (double[]){5, 5, 5}, 4, (double[]){1.0 / 3, 1.0 / 3, 1.0 / 3});
    check_weights(1, (double[]){123}, 4, (double[]){1});
}

static void weights_are_safe_at_a_centre(void **state)
{
    (void)state;
    check_weights(2, (double[]){0, 20}, 4, (double[]){1, 0});
    check_weights(3, (double[]){0, 7, 0}, 4, (double[]){0.5, 0, 0.5});
    check_weights(2, (double[]){0, 20}, 0, (double[]){0.5, 0.5});
    check_weights(2, (double[]){1e-320, 1e300}, 64, (double[]){1, 0});
    check_weights(2, (double[]){1e-200, 1e-200}, 64, (double[]){0.5, 0.5});
    check_weights(2, (double[]){1e300, 1e300}, 64, (double[]){0.5, 0.5});
}

static void distances_that_are_not_finite_weigh_nothing(void **state)
{
    (void)state;
    check_weights(3, (double[]){INFINITY, 3, NAN}, 4, (double[]){0, 1, 0});
    check_weights(2, (double[]){INFINITY, NAN}, 4, (double[]){0, 0});
    double same[2] = {10, 20};
    cn_compose_weights(2, same, 1, same);
    assert_near(same[0], 2.0 / 3, 1e-12);
    assert_near(same[1], 1.0 / 3, 1e-12);
}

/* Heights differ wildly: they must not count. */
static const double centres[4][3] = {{0, 0, 500}, {100, 0, 0}, {200, 0, 0}, {0, 60, -900}};
static const double radii[4] = {50, 50, 50, 20};

static void chooses_the_tiles_in_reach_nearest_first(void **state)
{
    (void)state;
    cn_compose_options options = cn_compose_options_default();
    uint32_t chosen[4];
    double weight[4];
    uint32_t n = cn_compose_choose(4, centres, radii, (double[]){70, 0, 9}, &options, chosen, weight);
    assert_int_equal(n, 2); /* 30 m and 70 m; tile 2 is 130 m off, tile 3 is 92 m off with a reach of 40 m */
    assert_int_equal(chosen[0], 1);
    assert_int_equal(chosen[1], 0);
    double r = pow(30.0 / 70.0, 4);
    assert_near(weight[0], 1 / (1 + r), 1e-12);
    assert_near(weight[1], r / (1 + r), 1e-12);
    n = cn_compose_choose(4, centres, radii, (double[]){100, 0, 9}, &options, chosen, weight);
    assert_int_equal(n, 3); /* the edge of the reach is in reach; equal distances by index */
    assert_int_equal(chosen[1], 0);
    assert_int_equal(chosen[2], 2);
    assert_near(weight[0], 1, 0);
    options.max_tiles = 1;
    n = cn_compose_choose(4, centres, radii, (double[]){70, 0, 9}, &options, chosen, weight);
    assert_int_equal(n, 1);
    assert_int_equal(chosen[0], 1);
    assert_near(weight[0], 1, 0);
}

static void max_tiles_keeps_the_nearest(void **state)
{
    (void)state;
    cn_compose_options options = {.exponent = 0, .reach = 100, .max_tiles = 2};
    uint32_t chosen[3] = {9, 9, 9};
    double weight[3] = {-1, -1, -1};
    assert_int_equal(cn_compose_choose(4, centres, radii, (double[]){190, 0, 0}, &options, chosen, weight), 2);
    assert_int_equal(chosen[0], 2);
    assert_int_equal(chosen[1], 1);
    assert_int_equal(chosen[2], 9); /* no more than max_tiles is written */
    assert_near(weight[2], -1, 0);
}

static void falls_back_to_the_nearest_tile(void **state)
{
    (void)state;
    cn_compose_options options = cn_compose_options_default();
    uint32_t chosen[4];
    double weight[4];
    assert_int_equal(cn_compose_choose(4, centres, radii, (double[]){1e6, 0, 0}, &options, chosen, weight), 1);
    assert_int_equal(chosen[0], 2);
    assert_near(weight[0], 1, 0);
    assert_int_equal(cn_compose_choose(0, centres, radii, (double[]){0, 0, 0}, &options, chosen, weight), 0);
    assert_int_equal(cn_compose_choose(4, centres, radii, (double[]){NAN, 0, 0}, &options, chosen, weight), 0);
    options.max_tiles = 0;
    assert_int_equal(cn_compose_choose(4, centres, radii, (double[]){0, 0, 0}, &options, chosen, weight), 0);
}

static void adds_colour_and_weighs_depth_by_alpha(void **state)
{
    (void)state;
    float a_rgba[8] = {0.5f, 0.25f, 0, 0.5f, 0, 0, 0, 0}, a_depth[2] = {10, 0};
    float b_rgba[8] = {1, 1, 1, 1, 0, 0, 0, 0}, b_depth[2] = {40, 0};
    float rgba[8] = {0}, depth[2] = {0};
    cn_picture a = {2, 1, a_rgba, a_depth}, b = {2, 1, b_rgba, b_depth}, out = {2, 1, rgba, depth};
    cn_compose_add(&out, &a, 0.5);
    cn_compose_add(&out, &b, 0.5);
    cn_compose_finish(&out);
    float want[4] = {0.75f, 0.625f, 0.5f, 0.75f};
    for (int i = 0; i < 4; i++) assert_near(rgba[i], want[i], 1e-6);
    assert_near(depth[0], (0.25 * 10 + 0.5 * 40) / 0.75, 1e-4);
    assert_near(depth[1], 0, 0); /* nothing there: no division by 0 */
    assert_near(rgba[7], 0, 0);
}

static void one_whole_tile_comes_out_unchanged(void **state)
{
    (void)state;
    float in_rgba[4] = {0.1f, 0.2f, 0.3f, 0.4f}, in_depth[1] = {7}, rgba[4] = {0}, depth[1] = {0};
    cn_picture in = {1, 1, in_rgba, in_depth}, out = {1, 1, rgba, depth};
    cn_compose_add(&out, &in, 1);
    cn_compose_finish(&out);
    assert_memory_equal(rgba, in_rgba, sizeof rgba);
    assert_near(depth[0], 7, 1e-6);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(weights_follow_the_power),
        cmocka_unit_test(weights_are_safe_at_a_centre),
        cmocka_unit_test(distances_that_are_not_finite_weigh_nothing),
        cmocka_unit_test(chooses_the_tiles_in_reach_nearest_first),
        cmocka_unit_test(max_tiles_keeps_the_nearest),
        cmocka_unit_test(falls_back_to_the_nearest_tile),
        cmocka_unit_test(adds_colour_and_weighs_depth_by_alpha),
        cmocka_unit_test(one_whole_tile_comes_out_unchanged),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
