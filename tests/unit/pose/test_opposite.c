#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "pose/opposite.h"
#include "pose/scene.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { VIEWS = 20, POINTS = 100, LONELY = 5, WRONG = 7 };

static char logged[1024];

static void note(void *user, cn_log_level level, const char *text)
{
    (void)user;
    (void)level;
    snprintf(logged + strlen(logged), sizeof logged - strlen(logged), "%s\n", text);
}

static const cn_context CONTEXT = { .log = note };

/* Cameras on a line before a wall, 10 m away. The first n_behind from WRONG on stand behind it. Each view sees every
 * point but the last LONELY ones, which WRONG and view 0 alone see. */
static void make(cn_scene *scene, uint32_t n_behind)
{
    *scene = (cn_scene){ .views = calloc(VIEWS, sizeof *scene->views),
                         .n_views = VIEWS,
                         .points = calloc(POINTS, sizeof *scene->points),
                         .n_points = POINTS,
                         .observations = calloc(POINTS * VIEWS, sizeof *scene->observations) };
    logged[0] = '\0';
    for (uint32_t i = 0; i < VIEWS; i++) {
        const bool behind = i >= WRONG && i < WRONG + n_behind;
        const double centre[3] = { 0.5 * i, behind ? 10 : -10, 0 };
        cn_view *view = &scene->views[i];
        *view = (cn_view){ .name = malloc(8), .photo = i, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
        snprintf(view->name, 8, "%02u.jpg", i);
        for (int k = 0; k < 3; k++)
            view->translation[k] = -centre[k];
    }
    for (uint32_t p = 0; p < POINTS; p++) {
        cn_point *point = &scene->points[p];
        *point =
            (cn_point){ .xyz = { 0.1 * p, 0, 0.01 * (p % 10) }, .first_observation = (uint32_t)scene->n_observations };
        for (uint32_t i = 0; i < VIEWS; i++)
            if (p < POINTS - LONELY || i == 0 || i == WRONG)
                scene->observations[scene->n_observations++] = (cn_observation){ .view = i };
        point->n_observations = (uint32_t)scene->n_observations - point->first_observation;
    }
}

static void test_right_poses_stay(void **state)
{
    (void)state;
    cn_scene scene;
    make(&scene, 0);
    assert_int_equal(cn_pose_drop_opposite(&CONTEXT, &scene), CN_OK);
    assert_int_equal(scene.n_views, VIEWS);
    assert_int_equal(scene.n_points, POINTS);
    assert_string_equal(logged, "");
    cn_scene_deinit(&scene);
}

static void test_a_view_from_behind_goes(void **state)
{
    (void)state;
    cn_scene scene;
    make(&scene, 1);
    assert_int_equal(cn_pose_drop_opposite(&CONTEXT, &scene), CN_OK);
    assert_int_equal(scene.n_views, VIEWS - 1);
    for (uint32_t i = 0; i < scene.n_views; i++)
        assert_int_not_equal(scene.views[i].photo, WRONG);
    /* Nothing confirms the points that it shared with one other view. */
    assert_int_equal(scene.n_points, POINTS - LONELY);
    assert_int_equal(scene.n_observations, (POINTS - LONELY) * (VIEWS - 1));
    assert_non_null(strstr(logged, "07.jpg gets no pose"));
    assert_non_null(strstr(logged, "100 of its 100 sparse points"));
    cn_scene_deinit(&scene);
}

/* With many of them it is not known which are wrong. Two that confirm each other, as from two sides of a thin wall, are
 * right. */
static void test_many_stay(void **state)
{
    (void)state;
    cn_scene scene;
    for (uint32_t n = 2; n <= 3; n++) {
        make(&scene, n);
        assert_int_equal(cn_pose_drop_opposite(&CONTEXT, &scene), CN_OK);
        assert_int_equal(scene.n_views, VIEWS);
        cn_scene_deinit(&scene);
    }
    /* From behind, from far above and from far below: each alone. */
    make(&scene, 3);
    scene.views[WRONG + 1].translation[2] = 700;
    scene.views[WRONG + 2].translation[2] = -700;
    assert_int_equal(cn_pose_drop_opposite(&CONTEXT, &scene), CN_OK);
    assert_int_equal(scene.n_views, VIEWS);
    assert_string_equal(logged, "");
    cn_scene_deinit(&scene);
    memset(&scene, 0, sizeof scene);
    assert_int_equal(cn_pose_drop_opposite(&CONTEXT, &scene), CN_OK);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_right_poses_stay),
        cmocka_unit_test(test_a_view_from_behind_goes),
        cmocka_unit_test(test_many_stay),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
