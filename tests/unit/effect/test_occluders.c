/* What one photo alone shows before others, on photos that the test draws. */
#include "wall.h"

#include "effect/occluders.h"

#include <stdlib.h>
#include <string.h>

static wall w;

static void find(before what, cn_occluders *found)
{
    wall_init(&w, what, NO_SKY);
    /* More points where the leaves are. */
    for (int i = 0; i < 64; i++)
        add_point(&w, what, (double[3]){ i % 4 - 1, WALL_M, i / 4 * 0.7 - 5.5 }, false);
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_int_equal(cn_occluders_find(&input, &w.tile, found), CN_OK);
}

/* Whether the ray through the middle of a cell hits the leaves. */
static bool shows_thing(unsigned view, int column, int row)
{
    const double origin[3] = { camera_x(view), 0, 2 };
    double in_camera[3];
    assert_int_equal(cn_camera_unproject(&w.camera, (column + 0.5) * WIDTH / CN_HIDDEN_COLUMNS,
                                         (row + 0.5) * HEIGHT / CN_HIDDEN_ROWS, in_camera),
                     CN_OK);
    /* Cameras look north. */
    return in_thing(LEAVES, view, origin, (double[3]){ in_camera[0], in_camera[2], -in_camera[1] });
}

/* Each cell that shows the leaves is found, and of the others only those beside them. */
static void leaves_before_one_photo_are_found(void **state)
{
    (void)state;
    cn_occluders found;
    find(LEAVES, &found);
    assert_int_equal(found.n_found, 1);
    for (uint32_t i = 0; i < VIEWS; i++)
        if (i != LEAVES_VIEW) assert_true(cn_occluders_share(&found, i) <= 0);
    uint32_t n_leaves = 0, n_missed = 0, n_far = 0;
    for (int row = 0; row < CN_HIDDEN_ROWS; row++)
        for (int column = 0; column < CN_HIDDEN_COLUMNS; column++) {
            const bool is_found = found.cells[LEAVES_VIEW][row] >> column & 1;
            bool near = false;
            for (int i = 0; i < 25; i++)
                near = near || shows_thing(LEAVES_VIEW, column + i % 5 - 2, row + i / 5 - 2);
            n_leaves += shows_thing(LEAVES_VIEW, column, row);
            n_missed += shows_thing(LEAVES_VIEW, column, row) && !is_found;
            n_far += is_found && !near;
        }
    assert_true(n_leaves > 50);
    assert_int_equal(n_missed, 0);
    assert_int_equal(n_far, 0);
    cn_occluders_deinit(&found);
    wall_deinit(&w);
}

/* A parked thing has points of its own. A smooth statue and a passer-by are in all photos. */
static void what_many_photos_show_stays(void **state)
{
    (void)state;
    static const before things[] = { NOTHING, PARKED, STATUE, PASSING };
    for (size_t i = 0; i < sizeof things / sizeof *things; i++) {
        cn_occluders found;
        find(things[i], &found);
        assert_int_equal(found.n_found, 0);
        for (uint32_t k = 0; k < VIEWS; k++)
            assert_true(cn_occluders_share(&found, k) <= 0);
        cn_occluders_deinit(&found);
        wall_deinit(&w);
    }
}

/* COLMAP's tracks may have two places in one photo. */
static void points_may_be_seen_twice(void **state)
{
    (void)state;
    static cn_observation twice[2 * POINTS * VIEWS];
    cn_occluders found;
    find(LEAVES, &found);
    cn_occluders_deinit(&found);
    for (uint64_t i = 0; i < w.scene.n_observations; i++)
        twice[2 * i] = twice[2 * i + 1] = w.observations[i];
    w.scene.observations = twice;
    w.scene.n_observations *= 2;
    for (uint32_t p = 0; p < w.scene.n_points; p++) {
        w.points[p].first_observation *= 2;
        w.points[p].n_observations *= 2;
    }
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_int_equal(cn_occluders_find(&input, &w.tile, &found), CN_OK);
    assert_int_equal(found.n_found, 1);
    assert_true(cn_occluders_share(&found, LEAVES_VIEW) > 0);
    cn_occluders_deinit(&found);
    wall_deinit(&w);
}

static void few_points_tell_nothing(void **state)
{
    (void)state;
    cn_occluders found;
    find(LEAVES, &found);
    cn_occluders_deinit(&found);
    w.scene.n_points = 199;
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_int_equal(cn_occluders_find(&input, &w.tile, &found), CN_OK);
    assert_int_equal(found.n_found, 0);
    assert_true(cn_occluders_share(&found, LEAVES_VIEW) <= 0);
    cn_occluders_deinit(&found);
    wall_deinit(&w);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(leaves_before_one_photo_are_found),
        cmocka_unit_test(what_many_photos_show_stays),
        cmocka_unit_test(points_may_be_seen_twice),
        cmocka_unit_test(few_points_tell_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
