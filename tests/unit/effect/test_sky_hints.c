/* Where photos show sky: evidence and hints, on photos of a wall that the test draws. */
#include "wall.h"

#include "effect/effect.h"
#include "effect/sky_hints.h"
#include "math/linalg.h"

#include <math.h>
#include <string.h>

/* The roof is at row 12 of 72: a sixth of each photo is sky. Points stand along the roof's edge. */
static void test_sky(void **state)
{
    (void)state;
    const double blue = evidence(cn_sky_hints_share, NOTHING, BLUE_SKY);
    const double with = evidence(cn_sky_hints_share, NOTHING, GREY_SKY),
                 without = evidence(cn_sky_hints_share, NOTHING, NO_SKY);
    assert_true(with > 0.14 && with < 0.18);
    assert_true(blue > 0.14 && blue < 0.18);
    assert_true(without < 0.02);
}

/* What is neither blue nor brighter than most of the rest may be a ceiling: its evidence is below the threshold, but
 * near enough to it for a probe. */
static void test_ceiling(void **state)
{
    (void)state;
    extern const cn_effect cn_effect_sky;
    windows = true;
    const double ceiling = evidence(cn_sky_hints_share, NOTHING, GREY_SKY),
                 blue = evidence(cn_sky_hints_share, NOTHING, BLUE_SKY);
    windows = false;
    assert_true(ceiling < cn_effect_sky.threshold && ceiling > cn_effect_sky.threshold / 4);
    assert_true(blue > 0.14 && blue < 0.18);
}

/* Drops what views from `end` on see of the points. */
static void keep_observations_before(wall *w, uint32_t end)
{
    for (uint32_t i = 0; i < w->scene.n_points; i++) {
        cn_point *p = &w->points[i];
        while (p->n_observations && w->observations[p->first_observation + p->n_observations - 1].view >= end)
            p->n_observations--;
    }
}

/* Photos without points do not count as photos without sky. Points of two views are enough for two photos, but not for
 * more: then nothing is measured. */
static void test_sky_of_photos_without_points(void **state)
{
    (void)state;
    static wall w;
    wall_init(&w, NOTHING, GREY_SKY);
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    keep_observations_before(&w, VIEWS / 2);
    const double half = cn_sky_hints_share(&input, &w.tile);
    assert_true(half > 0.14 && half < 0.18);
    keep_observations_before(&w, 2);
    assert_true(isnan(cn_sky_hints_share(&input, &w.tile)));
    w.tile.n_photos = 2;
    const double two = cn_sky_hints_share(&input, &w.tile);
    assert_true(two > 0.14 && two < 0.18);
    wall_deinit(&w);
}

/* The sky is known up to two hints from the roof, although sparse points stand on the roof's edge. Below the points of
 * a column no hint tells of sky. */
static void test_sky_hints(void **state)
{
    (void)state;
    static wall w;
    static uint8_t hint[VIEWS * CN_SKY_HINTS];
    const uint32_t roof = 12 * CN_SKY_HINT_Y / HEIGHT;
    wall_init(&w, NOTHING, GREY_SKY);
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_true(cn_sky_hints_find(&input, &w.tile, hint));
    uint32_t shown = 0, none = 0;
    for (uint32_t i = 0; i < sizeof hint; i++) {
        const uint32_t y = i / CN_SKY_HINT_X % CN_SKY_HINT_Y;
        if (y < roof)
            assert_int_not_equal(hint[i], CN_SKY_NONE);
        else
            assert_int_not_equal(hint[i], CN_SKY_SHOWN);
        shown += y + 4 < roof && hint[i] == CN_SKY_SHOWN;
        none += y > roof + 16 && hint[i] == CN_SKY_NONE;
    }
    assert_int_equal(shown, VIEWS * (roof - 4) * CN_SKY_HINT_X);
    assert_true(none > sizeof hint / 2);
    /* A photo without points tells nothing. */
    w.scene.n_points = 0;
    assert_true(cn_sky_hints_find(&input, &w.tile, hint));
    for (uint32_t i = 0; i < sizeof hint; i++)
        assert_int_equal(hint[i], CN_SKY_UNKNOWN);
    wall_deinit(&w);
}

/* Where view 0 looks at a hint's middle. */
static void look(const wall *w, uint32_t i, double dir[3])
{
    const double x = i % CN_SKY_HINT_X + 0.5, y = i / CN_SKY_HINT_X + 0.5;
    double in_camera[3];
    assert_int_equal(cn_camera_unproject(&w->camera, x * WIDTH / CN_SKY_HINT_X, y * HEIGHT / CN_SKY_HINT_Y, in_camera),
                     CN_OK);
    cn_mat3_tvec(w->views[0].rotation, in_camera, dir);
}

/* Hints of view 0 within the tower or cloud, above the roof and away from its edges. */
static void count_hints(const wall *w, before what, const uint8_t *hint, uint32_t n[3])
{
    const double origin[3] = { camera_x(0), 0, 2 };
    memset(n, 0, 3 * sizeof *n);
    for (uint32_t i = 0; i < CN_SKY_HINTS; i++) {
        double dir[3];
        look(w, i, dir);
        const double across = origin[0] + BOX_M / dir[1] * dir[0], up = origin[2] + BOX_M / dir[1] * dir[2];
        if (!in_thing(what, 0, origin, dir) || fabs(across) > 0.8 || up < (what == CLOUD ? 6 : 5.3)) continue;
        assert_true(hint[i] <= CN_SKY_SHOWN);
        n[hint[i]]++;
    }
}

/* Something reaches to the top edge of view 0, without points of that view. seen_by_others: other views see points on
 * it. */
static void hints_on(before what, double grey, bool seen_by_others, uint32_t n[3])
{
    static wall w;
    static uint8_t hint[VIEWS * CN_SKY_HINTS];
    thing_grey = grey;
    wall_init(&w, what, GREY_SKY);
    for (int i = 0; seen_by_others && i < 50; i++) {
        cn_point *p = &w.points[w.scene.n_points];
        add_point(&w, what, (double[3]){ i % 10 * 0.2 - 0.9, BOX_M, 5.1 + 0.34 * (i / 10) }, true);
        while (w.observations[p->first_observation].view < VIEWS / 2) {
            p->first_observation++;
            p->n_observations--;
        }
    }
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_true(cn_sky_hints_find(&input, &w.tile, hint));
    count_hints(&w, what, hint, n);
    wall_deinit(&w);
    thing_grey = 0.02;
}

/* A smooth wall that reaches to the top of a photo looks like sky. It is none where other photos see points, and none
 * when its colour is not that of the rest. What is dark is no sky, but may be a cloud when sky is below it. A bright
 * cloud is sky. */
static void test_no_sky_at_top(void **state)
{
    (void)state;
    uint32_t n[3];
    hints_on(TOWER, 0.6, false, n); /* looks like the sky: nothing tells it apart */
    assert_true(n[CN_SKY_SHOWN] > 500 && n[CN_SKY_NONE] == 0);
    hints_on(TOWER, 0.6, true, n);
    assert_true(n[CN_SKY_NONE] > 500 && n[CN_SKY_SHOWN] < 250); /* shown: between points and the photo's edge */
    hints_on(TOWER, 0.42, false, n);
    assert_int_equal(n[CN_SKY_SHOWN], 0);
    assert_int_equal(n[CN_SKY_NONE], 0);
    hints_on(TOWER, 0.1, false, n);
    assert_true(n[CN_SKY_NONE] > 500 && n[CN_SKY_SHOWN] == 0);
    hints_on(CLOUD, 0.1, false, n);
    assert_true(n[CN_SKY_UNKNOWN] > 100 && n[CN_SKY_NONE] == 0 && n[CN_SKY_SHOWN] == 0);
    hints_on(CLOUD, 0.9, false, n);
    assert_true(n[CN_SKY_SHOWN] > 100 && n[CN_SKY_NONE] == 0 && n[CN_SKY_UNKNOWN] == 0);
}

/* Points that are off the roof's edge, in the sky, do not hide the sky between them and the roof. */
static void test_sky_along_roof(void **state)
{
    (void)state;
    static wall w;
    static uint8_t hint[VIEWS * CN_SKY_HINTS];
    const uint32_t roof = 12 * CN_SKY_HINT_Y / HEIGHT;
    wall_init(&w, NOTHING, GREY_SKY);
    for (int i = 0; i < 50; i++)
        add_point(&w, NOTHING, (double[3]){ i * 0.5 - 12.5, WALL_M, ROOF_M + 0.5 }, false);
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_true(cn_sky_hints_find(&input, &w.tile, hint));
    for (uint32_t i = 0; i < sizeof hint; i++) {
        const uint32_t y = i / CN_SKY_HINT_X % CN_SKY_HINT_Y;
        if (y + 2 < roof) assert_int_equal(hint[i], CN_SKY_SHOWN);
        if (y >= roof) assert_int_not_equal(hint[i], CN_SKY_SHOWN);
    }
    wall_deinit(&w);
}

/* A wall as bright as the sky, beside it, goes on for more than a strip. It is no sky. */
static void test_no_sky_across_a_wall(void **state)
{
    (void)state;
    static wall w;
    static uint8_t hint[VIEWS * CN_SKY_HINTS];
    white_wall = true;
    wall_init(&w, NOTHING, GREY_SKY);
    white_wall = false;
    w.scene.n_points = 0;
    w.scene.n_observations = 0;
    for (int i = 0; i < 40; i++)
        add_point(&w, NOTHING, (double[3]){ WHITE_TO_M - 0.5 - i * 0.5, WALL_M, ROOF_M - 0.2 }, false);
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_true(cn_sky_hints_find(&input, &w.tile, hint));
    uint32_t beside = 0;
    for (uint32_t i = 24 * CN_SKY_HINT_X; i < 80 * CN_SKY_HINT_X; i++) { /* from above the roof's edge to the horizon */
        const double x = camera_x(0) + ((i % CN_SKY_HINT_X + 0.5) * WIDTH / CN_SKY_HINT_X - 48) / 80 * WALL_M;
        if (x < WHITE_TO_M - 1 && i / CN_SKY_HINT_X > 48)
            assert_int_not_equal(hint[i], CN_SKY_SHOWN);
        else if (x > WHITE_TO_M + 1)
            beside += hint[i] == CN_SKY_SHOWN;
    }
    assert_true(beside > 500);
    wall_deinit(&w);
}

/* The border of a photo is no sky, and below it the sky is found. */
static void test_sky_below_border(void **state)
{
    (void)state;
    static wall w;
    static uint8_t hint[VIEWS * CN_SKY_HINTS];
    border_px = 4;
    wall_init(&w, NOTHING, GREY_SKY);
    border_px = 0;
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_true(cn_sky_hints_find(&input, &w.tile, hint));
    const uint32_t first = 4 * CN_SKY_HINT_Y / HEIGHT + 2, roof = 12 * CN_SKY_HINT_Y / HEIGHT;
    for (uint32_t i = 0; i < sizeof hint; i++) {
        const uint32_t y = i / CN_SKY_HINT_X % CN_SKY_HINT_Y;
        if (y >= first && y < roof - 4) assert_int_equal(hint[i], CN_SKY_SHOWN);
    }
    wall_deinit(&w);
}

/* A photo that stands on its side or head tells of its sky as an upright one does. */
static void test_turned_photo(void **state)
{
    (void)state;
    static wall w;
    static uint8_t hint[VIEWS * CN_SKY_HINTS];
    for (first_turn = CN_SIDE_LEFT; first_turn <= CN_SIDE_BOTTOM; first_turn++) {
        uint32_t n[2][CN_SKY_SHOWN + 1] = { { 0 } }; /* of the wall, of the sky */
        wall_init(&w, NOTHING, GREY_SKY);
        assert_int_equal(cn_view_side_up(&w.views[0]), first_turn);
        const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
        assert_true(cn_sky_hints_find(&input, &w.tile, hint));
        for (uint32_t i = 0; i < CN_SKY_HINTS; i++) {
            double dir[3];
            look(&w, i, dir);
            const double above = dir[2] / dir[1] - (ROOF_M - 2) / WALL_M;
            if (fabs(above) > 0.03) n[above > 0][hint[i]]++;
        }
        assert_true(n[1][CN_SKY_SHOWN] > 1000 && !n[1][CN_SKY_NONE] && !n[1][CN_SKY_UNKNOWN]);
        assert_true(!n[0][CN_SKY_SHOWN] && n[0][CN_SKY_NONE] > 4 * n[0][CN_SKY_UNKNOWN]);
        wall_deinit(&w);
    }
    first_turn = CN_SIDE_TOP;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sky),
        cmocka_unit_test(test_ceiling),
        cmocka_unit_test(test_sky_of_photos_without_points),
        cmocka_unit_test(test_sky_hints),
        cmocka_unit_test(test_no_sky_at_top),
        cmocka_unit_test(test_sky_along_roof),
        cmocka_unit_test(test_no_sky_across_a_wall),
        cmocka_unit_test(test_sky_below_border),
        cmocka_unit_test(test_turned_photo),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
