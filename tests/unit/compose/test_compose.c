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
    for (uint32_t i = 0; i < n; i++)
        assert_near(weight[i], want[i], 1e-12);
}

static void weights_follow_the_power(void **state)
{
    (void)state;
    check_weights(2, (double[]){ 10, 20 }, 1, (double[]){ 2.0 / 3, 1.0 / 3 });
    check_weights(2, (double[]){ 10, 20 }, 4, (double[]){ 16.0 / 17, 1.0 / 17 });
    check_weights(3, (double[]){ 5, 5, 5 }, 4, (double[]){ 1.0 / 3, 1.0 / 3, 1.0 / 3 });
    check_weights(1, (double[]){ 123 }, 4, (double[]){ 1 });
}

static void weights_are_safe_at_a_centre(void **state)
{
    (void)state;
    check_weights(2, (double[]){ 0, 20 }, 4, (double[]){ 1, 0 });
    check_weights(3, (double[]){ 0, 7, 0 }, 4, (double[]){ 0.5, 0, 0.5 });
    check_weights(2, (double[]){ 0, 20 }, 0, (double[]){ 0.5, 0.5 });
    check_weights(2, (double[]){ 1e-320, 1e300 }, 64, (double[]){ 1, 0 });
    check_weights(2, (double[]){ 1e-200, 1e-200 }, 64, (double[]){ 0.5, 0.5 });
    check_weights(2, (double[]){ 1e300, 1e300 }, 64, (double[]){ 0.5, 0.5 });
}

static void distances_that_are_not_finite_weigh_nothing(void **state)
{
    (void)state;
    check_weights(3, (double[]){ INFINITY, 3, NAN }, 4, (double[]){ 0, 1, 0 });
    check_weights(2, (double[]){ INFINITY, NAN }, 4, (double[]){ 0, 0 });
    double same[2] = { 10, 20 };
    cn_compose_weights(2, same, 1, same);
    assert_near(same[0], 2.0 / 3, 1e-12);
    assert_near(same[1], 1.0 / 3, 1e-12);
}

/* Heights differ widely. They must have no influence. */
static const double centres[4][3] = { { 0, 0, 500 }, { 100, 0, 0 }, { 200, 0, 0 }, { 0, 60, -900 } };
static const double radii[4] = { 50, 50, 50, 20 };

static cn_compose_choice choose(double x, double y, const cn_compose_options *options)
{
    cn_compose_choice c;
    cn_compose_choose(4, centres, radii, (double[]){ x, y, 9 }, options, &c);
    return c;
}

static void chooses_the_tiles_in_reach_heaviest_first(void **state)
{
    (void)state;
    cn_compose_options options = cn_compose_options_default();
    cn_compose_choice c =
        choose(60, 0, &options); /* 40 m and 60 m; tile 2 is 140 m off, tile 3 85 m with a reach of 40 m */
    assert_int_equal(c.n, 2);
    assert_int_equal(c.tile[0], 1);
    assert_int_equal(c.tile[1], 0);
    const double fade[2] = { pow(1 - 0.16, 2), pow(1 - 0.36, 2) };
    const double a = fade[0] * 0.99, b = fade[1] * pow(40.0 / 60.0, 4) - 0.01 * fade[0]; /* less the floor */
    assert_near(c.weight[0], a / (a + b), 1e-12);
    assert_near(c.weight[1], b / (a + b), 1e-12);
    assert_near(c.coverage, 1, 0);
    options.max_tiles = 1;
    c = choose(60, 0, &options);
    assert_int_equal(c.n, 1);
    assert_int_equal(c.tile[0], 1);
    assert_near(c.weight[0], 1, 0);
}

static void weights_are_exact_where_they_can_be(void **state)
{
    (void)state;
    static const cn_blend by_picture[] = { CN_BLEND_NEAREST, CN_BLEND_DISTANCE_2D };
    cn_compose_options options = cn_compose_options_default();
    for (int i = 0; i < 2; i++) {
        options.scheme = by_picture[i];
        const cn_compose_choice at_centre = choose(100, 0, &options);
        assert_int_equal(at_centre.n, 1);
        assert_int_equal(at_centre.tile[0], 1);
        assert_near(at_centre.weight[0], 1, 0);
        const cn_compose_choice alone = choose(-20, 0, &options);
        assert_int_equal(alone.n, 1);
        assert_near(alone.weight[0], 1, 0);
    }
    const cn_compose_choice between = choose(150, 0, &options);
    assert_int_equal(between.n, 2);
    assert_near(between.weight[0], 0.5, 0);
    assert_near(between.weight[1], 0.5, 0);
    assert_int_equal(between.tile[0], 1); /* equal ones by index */
    options.scheme = CN_BLEND_OWNERSHIP;
    const cn_compose_choice shared = choose(150, 0, &options);
    assert_int_equal(shared.n, 2);
    assert_near(shared.weight[0], 1, 0); /* both take part in full */
    assert_near(shared.weight[1], 1, 0);
}

static void a_photo_sees_its_tile_from_afar(void **state)
{
    (void)state;
    const cn_compose_options options = cn_compose_options_default();
    const double from[3] = { 90, 120, 200 }; /* 150 m from the centre of a tile whose reach is 80 m */
    cn_compose_choice c;
    double radius = 40;
    cn_compose_choose(1, centres, &radius, from, &options, &c);
    assert_int_equal(c.n, 0);
    radius = cn_compose_radius(40, 150, &options);
    cn_compose_choose(1, centres, &radius, from, &options, &c);
    assert_int_equal(c.n, 1);
    assert_near(c.coverage, 1, 1e-9);
    assert_near(cn_compose_radius(40, 70, &options), 40, 0); /* in reach already */
}

static void nothing_is_chosen_beyond_every_reach(void **state)
{
    (void)state;
    cn_compose_options options = cn_compose_options_default();
    cn_compose_choice c = choose(1e6, 0, &options);
    assert_int_equal(c.n, 0);
    assert_int_equal(choose(NAN, 0, &options).n, 0);
    options.max_tiles = 0;
    assert_int_equal(choose(0, 0, &options).n, 0);
    cn_compose_choose(0, centres, radii, (double[]){ 0, 0, 0 }, &options, &c);
    assert_int_equal(c.n, 0);
}

/* A share of a tile in the picture, as the scheme's weights have it. */
static void picture_shares(const cn_compose_choice *c, double share[9])
{
    double sum = 0;
    for (uint32_t i = 0; i < c->n; i++)
        sum += c->weight[i];
    for (int i = 0; i < 9; i++)
        share[i] = 0;
    for (uint32_t i = 0; i < c->n; i++)
        share[c->tile[i]] = c->coverage * c->weight[i] / sum;
}

/* The largest change of a tile's share in one of so many steps of a walk among nine tiles a little off a grid, which
 * enter and leave by reach, by max_tiles and by the floor. The walk ends beyond every reach. */
static double largest_step(const cn_compose_options *options, int steps)
{
    double at[9][3] = { { 0 } }, radius[9], before[9], now[9], most = 0;
    for (int i = 0; i < 9; i++) {
        at[i][0] = 30 * (i % 3) + 1.7 * i;
        at[i][1] = 30 * (i / 3) - 0.9 * i * i;
        radius[i] = 30 + i;
    }
    for (int step = 0; step <= steps; step++) {
        cn_compose_choice c;
        const double s = (double)step / steps, camera[3] = { -60 + 330 * s, 71 * s + 20 * sin(9 * s), 30 };
        cn_compose_choose(9, at, radius, camera, options, &c);
        picture_shares(&c, now);
        for (int i = 0; i < 9 && step; i++)
            most = fmax(most, fabs(now[i] - before[i]));
        memcpy(before, now, sizeof now);
    }
    return most;
}

/* Where a share changes continuously, a quarter of the step changes a quarter as much; a jump stays as large. */
static void no_step_of_a_walk_jumps(void **state)
{
    (void)state;
    static const cn_blend schemes[] = { CN_BLEND_DISTANCE_2D, CN_BLEND_DISTANCE_3D, CN_BLEND_VISIBILITY,
                                        CN_BLEND_OWNERSHIP };
    for (size_t k = 0; k < 4; k++)
        for (uint32_t max = 2; max <= 4; max++) { /* one tile at a time cannot but jump */
            const cn_compose_options options = { schemes[k], 4, 2, max, 0.05 };
            const double coarse = largest_step(&options, 40000), fine = largest_step(&options, 160000);
            assert_true(coarse < 0.1 && coarse > 1e-4);
            assert_true(fine < 0.3 * coarse);
        }
    const cn_compose_options nearest = { CN_BLEND_NEAREST, 4, 2, 4, 0.05 };
    assert_near(largest_step(&nearest, 40000), 1, 0); /* so the measure can fail */
}

static void what_sees_little_is_left_out(void **state)
{
    (void)state;
    cn_compose_options options = cn_compose_options_default();
    cn_compose_choice c = choose(150, 0, &options);
    assert_true(cn_compose_wants_visibility(&c, &options));
    cn_compose_see(&c, (double[]){ 0.001, 0.9 }, &options);
    assert_int_equal(c.n, 1);
    assert_int_equal(c.tile[0], 2);
    assert_near(c.weight[0], 1, 0);
    assert_false(cn_compose_wants_visibility(&c, &options));
    c = choose(150, 0, &options);
    cn_compose_see(&c, (double[]){ 0.4, 0.9 }, &options); /* sees less, but enough */
    assert_near(c.weight[0], 0.5, 1e-12);
    c = choose(150, 0, &options);
    cn_compose_see(&c, (double[]){ 0, 0 }, &options); /* the sky */
    assert_int_equal(c.n, 2);
    assert_near(c.weight[0], 0.5, 1e-12);
    options.scheme = CN_BLEND_VISIBILITY;
    c = choose(150, 0, &options);
    cn_compose_see(&c, (double[]){ 0.44, 0.89 }, &options);
    assert_int_equal(c.tile[0], 2);
    assert_near(c.weight[0], 2.0 / 3, 1e-9);
    double last = 0.5, most = 0;
    options.scheme = CN_BLEND_DISTANCE_2D;
    for (int i = 1000; i >= 0; i--) {
        c = choose(150, 0, &options);
        cn_compose_see(&c, (double[]){ 0.2 * i / 1000, 0.9 }, &options);
        const double share = c.n < 2 ? 0 : c.tile[0] == 1 ? c.weight[0] : c.weight[1];
        most = fmax(most, fabs(share - last));
        last = share;
    }
    assert_true(most < 0.01); /* no jump at the threshold either */
    assert_near(last, 0, 0);
}

static void names_and_schemes_agree(void **state)
{
    (void)state;
    for (int i = CN_BLEND_NEAREST; i <= CN_BLEND_OWNERSHIP; i++) {
        cn_blend blend;
        assert_int_equal(cn_blend_parse(cn_blend_name((cn_blend)i), &blend), CN_OK);
        assert_int_equal(blend, i);
    }
    cn_blend blend;
    assert_int_equal(cn_blend_parse("best", &blend), CN_ERR_USAGE);
    assert_non_null(strstr(cn_error_message(), "ownership"));
}

typedef struct two {
    float a_rgba[8], a_depth[2], b_rgba[8], b_depth[2], rgba[8], depth[2];
    cn_picture a, b, out;
    cn_compose_sum sum;
} two;
static void two_init(two *t)
{
    t->a = (cn_picture){ .width = 2, .height = 1, .rgba = t->a_rgba, .depth = t->a_depth };
    t->b = (cn_picture){ .width = 2, .height = 1, .rgba = t->b_rgba, .depth = t->b_depth };
    t->out = (cn_picture){ .width = 2, .height = 1, .rgba = t->rgba, .depth = t->depth };
    assert_int_equal(cn_compose_sum_init(&t->sum, &t->out), CN_OK);
}

static void mixes_colour_and_depth_by_weight_and_alpha(void **state)
{
    (void)state;
    two t = { .a_rgba = { 0.5f, 0.25f, 0, 0.5f },
              .a_depth = { 10 },
              .b_rgba = { 1, 1, 1, 1 },
              .b_depth = { 40 },
              .rgba = { 9 },
              .depth = { 9 } };
    float border[2];
    two_init(&t);
    cn_compose_add(&t.sum, &t.a, 0.5);
    cn_compose_add(&t.sum, &t.b, 0.5);
    cn_compose_finish(&t.sum, border);
    const double alpha = (pow(0.5, 5) + 1) / (pow(0.5, 4) + 1); /* by the fourth power of alpha */
    const double want[4] = { 1.5 / 1.5 * alpha, 1.25 / 1.5 * alpha, 1 / 1.5 * alpha, alpha };
    for (int i = 0; i < 4; i++)
        assert_near(t.rgba[i], want[i], 1e-6);
    assert_near(t.depth[0], (0.25 * 10 + 0.5 * 40) / 0.75, 1e-4);
    assert_near(t.depth[1], 0, 0); /* nothing there: no division by 0 */
    assert_near(t.rgba[7], 0, 0);
    assert_near(border[0], 0.5 / 1.5, 1e-6);
    cn_compose_sum_deinit(&t.sum);
}

/* A sky is opaque and has no depth: it must not pull the depth of what stands before it towards 0. */
static void what_has_no_depth_does_not_change_it(void **state)
{
    (void)state;
    two t = { .a_rgba = { 1, 1, 1, 1, 1, 1, 1, 1 },
              .a_depth = { 10, 10 },
              .b_rgba = { 0, 0, 1, 1, 0, 0, 1, 1 },
              .b_depth = { 0, 0 } };
    two_init(&t);
    cn_compose_add(&t.sum, &t.a, 0.6);
    cn_compose_add(&t.sum, &t.b, 0.4);
    cn_compose_finish(&t.sum, NULL);
    assert_near(t.depth[0], 10, 1e-4);
    assert_near(t.rgba[3], 1, 1e-6);
    cn_compose_sum_deinit(&t.sum);
    two_init(&t);
    cn_compose_add(&t.sum, &t.a, 0.4); /* mostly sky */
    cn_compose_add(&t.sum, &t.b, 0.6);
    cn_compose_finish(&t.sum, NULL);
    assert_near(t.depth[0], 0, 0);
    cn_compose_sum_deinit(&t.sum);
}

static void one_whole_tile_comes_out_unchanged(void **state)
{
    (void)state;
    two t = { .a_rgba = { 0.1f, 0.2f, 0.3f, 0.4f }, .a_depth = { 7 } };
    two_init(&t);
    cn_compose_add(&t.sum, &t.a, 1);
    cn_compose_finish(&t.sum, NULL);
    assert_memory_equal(t.rgba, t.a_rgba, sizeof t.rgba);
    assert_near(t.depth[0], 7, 1e-6);
    cn_compose_sum_deinit(&t.sum);
    two_init(&t);
    cn_compose_add(&t.sum, &t.a, 1);
    cn_compose_finish(&t.sum, NULL);
    cn_compose_fade(&t.out, 0.25); /* near the end of the reach */
    assert_near(t.rgba[3], 0.1, 1e-7);
    assert_near(t.out.fade, 0.75, 0);
    assert_near(t.depth[0], 7, 1e-6);
    cn_compose_sum_deinit(&t.sum);
}

/* A tile without a sky beside one with it, and a hole in one tile that another sees: what a tile lacks takes nothing
 * away, and is not its own. Its haze takes nothing away either. A tile that enters with weight 0 changes nothing. */
static void what_a_tile_lacks_takes_nothing_away(void **state)
{
    (void)state;
    const double shares[] = { 0.2, 0.5, 0.98 }; /* of the tile that sees */
    for (int k = 0; k < 3; k++)
        for (int first = 0; first < 2; first++) {
            two t = { .a_rgba = { 0, 0, 0, 0, 0.02f, 0.01f, 0, 0.1f },
                      .a_depth = { 0, 3 },
                      .b_rgba = { 0.1f, 0.2f, 0.9f, 1, 0.3f, 0.2f, 0.1f, 1 },
                      .b_depth = { 0, 10 } };
            uint32_t heaviest[2] = { 9, 9 };
            float border[2];
            two_init(&t);
            t.sum.heaviest = heaviest;
            cn_compose_add(&t.sum, first ? &t.a : &t.b, first ? 1 - shares[k] : shares[k]);
            cn_compose_add(&t.sum, first ? &t.b : &t.a, first ? shares[k] : 1 - shares[k]);
            cn_compose_finish(&t.sum, border);
            for (int c = 0; c < 4; c++)
                assert_near(t.rgba[c], t.b_rgba[c], 1e-6);
            assert_true(t.rgba[7] > 0.99);
            assert_near(t.depth[0], 0, 0);
            assert_true(border[0] == 0 && heaviest[0] == (uint32_t)first && heaviest[1] == (uint32_t)first);
            cn_compose_sum_deinit(&t.sum);
        }
    double before = 0;
    for (int k = 0; k < 200; k++) { /* the tile that sees enters */
        two t = { .a_rgba = { 0, 0, 0, 0, 0.1f, 0.1f, 0, 0.2f },
                  .a_depth = { 0, 3 },
                  .b_rgba = { 0.1f, 0.2f, 0.9f, 1, 0.3f, 0.2f, 0.1f, 1 },
                  .b_depth = { 0, 10 } };
        const double weight = k / 800.0;
        two_init(&t);
        cn_compose_add(&t.sum, &t.a, 1 - weight);
        if (k) cn_compose_add(&t.sum, &t.b, weight);
        cn_compose_finish(&t.sum, NULL);
        assert_true(t.rgba[3] <= 6 * weight + 1e-6 && fabs((double)t.rgba[7] - (k ? before : 0.2)) < 0.02);
        before = (double)t.rgba[7];
        cn_compose_sum_deinit(&t.sum);
    }
    assert_true(before > 0.98);
}

/* Pictures that agree come out as they are, whatever their weights. */
static void pictures_that_agree_stay(void **state)
{
    (void)state;
    two t = { .a_rgba = { 0.1f, 0.2f, 0.3f, 0.7f, 0.1f, 0.2f, 0.3f, 1 }, .a_depth = { 7, 8 } };
    two_init(&t);
    cn_compose_add(&t.sum, &t.a, 0.3);
    cn_compose_add(&t.sum, &t.a, 0.6);
    cn_compose_add(&t.sum, &t.a, 0.1);
    cn_compose_finish(&t.sum, NULL);
    for (int i = 0; i < 8; i++)
        assert_near(t.rgba[i], t.a_rgba[i], 1e-6);
    assert_near(t.depth[0], 7, 1e-5);
    cn_compose_sum_deinit(&t.sum);
}

/* The camera looks along z from the origin at points 10 m away in one picture, and 20 m in the other. */
static void three_dimensions_weigh_by_what_is_shown(void **state)
{
    (void)state;
    const cn_camera camera = { .lens = CN_LENS_PINHOLE, .width = 2, .height = 1, .params = { 1e6, 1e6, 0.5, 0.5 } };
    const cn_view view = { .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
    const double exponents[3] = { 1, 4, 64 };
    for (int e = 0; e < 3; e++) {
        two t = { .a_rgba = { 1, 0, 0, 1, 1, 0, 0, 1 },
                  .a_depth = { 10, 10 },
                  .b_rgba = { 0, 1, 0, 1, 0, 1, 0, 1 },
                  .b_depth = { 20, 0 } };
        two_init(&t);
        cn_compose_add_3d(
            NULL, &t.sum, &t.a,
            &(cn_compose_distance){ &camera, &view, (double[]){ 0, 0, 14 }, 1, exponents[e] }); /* 4 m off */
        cn_compose_add_3d(
            NULL, &t.sum, &t.b,
            &(cn_compose_distance){ &camera, &view, (double[]){ 0, 0, 23 }, 1, exponents[e] }); /* 3 m off */
        cn_compose_finish(&t.sum, NULL);
        const double r = pow(3.0 / 4.0, exponents[e]);
        assert_near(t.rgba[0], r / (1 + r), 1e-4);
        assert_near(t.rgba[1], 1 / (1 + r), 1e-4);
        assert_true(t.rgba[4] > 0.99); /* without depth it shows something far off */
        cn_compose_sum_deinit(&t.sum);
    }
    two t = { .a_rgba = { 1, 0, 0, 1 }, .a_depth = { 10 }, .b_rgba = { 0, 1, 0, 1 }, .b_depth = { 10 } };
    two_init(&t);
    cn_compose_add_3d(
        NULL, &t.sum, &t.a,
        &(cn_compose_distance){ &camera, &view, (double[]){ 0, 0, 10 }, 1, 64 }); /* at the centre itself */
    cn_compose_add_3d(NULL, &t.sum, &t.b, &(cn_compose_distance){ &camera, &view, (double[]){ 0, 0, 30 }, 1, 64 });
    cn_compose_finish(&t.sum, NULL);
    assert_near(t.rgba[0], 1, 0);
    cn_compose_sum_deinit(&t.sum);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(weights_follow_the_power),
        cmocka_unit_test(weights_are_safe_at_a_centre),
        cmocka_unit_test(distances_that_are_not_finite_weigh_nothing),
        cmocka_unit_test(chooses_the_tiles_in_reach_heaviest_first),
        cmocka_unit_test(weights_are_exact_where_they_can_be),
        cmocka_unit_test(a_photo_sees_its_tile_from_afar),
        cmocka_unit_test(nothing_is_chosen_beyond_every_reach),
        cmocka_unit_test(no_step_of_a_walk_jumps),
        cmocka_unit_test(what_sees_little_is_left_out),
        cmocka_unit_test(names_and_schemes_agree),
        cmocka_unit_test(mixes_colour_and_depth_by_weight_and_alpha),
        cmocka_unit_test(what_has_no_depth_does_not_change_it),
        cmocka_unit_test(what_a_tile_lacks_takes_nothing_away),
        cmocka_unit_test(pictures_that_agree_stay),
        cmocka_unit_test(one_whole_tile_comes_out_unchanged),
        cmocka_unit_test(three_dimensions_weigh_by_what_is_shown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
