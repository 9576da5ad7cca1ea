#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "pose/outlier.h"
#include "pose/scene.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { VIEWS = 20, POINTS = 100, SEEN = 10, LONELY = 4, ODD = 7 };

static char logged[LOGGED];

static const cn_context CONTEXT = { .log = log_append, .user = logged };

/* What is odd about the views from ODD on. All but NOTHING see SEEN points only. */
typedef enum oddity { NOTHING, FEW, LARGE_ERRORS, OTHER_SIDE, FAR_AWAY } oddity;

/* Cameras on a line before a wall, 10 m away; OTHER_SIDE: 10 m behind it, FAR_AWAY: 500 m. A few of the points that an
 * odd view sees, one other view sees alone. */
static void make(cn_scene *scene, oddity what, uint32_t n_odd)
{
    static const double front[9] = { 1, 0, 0, 0, 0, -1, 0, 1, 0 }, back[9] = { -1, 0, 0, 0, 0, -1, 0, -1, 0 };
    *scene = (cn_scene){ .cameras = calloc(1, sizeof *scene->cameras),
                         .n_cameras = 1,
                         .views = calloc(VIEWS, sizeof *scene->views),
                         .n_views = VIEWS,
                         .points = calloc(POINTS, sizeof *scene->points),
                         .n_points = POINTS,
                         .observations = calloc(POINTS * VIEWS, sizeof *scene->observations) };
    scene->cameras[0] =
        (cn_camera){ .lens = CN_LENS_PINHOLE, .width = 900, .height = 600, .params = { 900, 900, 450, 300 } };
    logged[0] = '\0';
    for (uint32_t i = 0; i < VIEWS; i++) {
        const bool odd = i >= ODD && i < ODD + n_odd, behind = odd && what >= OTHER_SIDE;
        const double centre[3] = { 0.5 * i, behind ? (what == FAR_AWAY ? 500 : 10) : -10, 0 };
        cn_view *view = &scene->views[i];
        *view = (cn_view){ .name = malloc(8), .photo = i };
        snprintf(view->name, 8, "%02u.jpg", i);
        memcpy(view->rotation, behind ? back : front, sizeof front);
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++)
                view->translation[k] -= view->rotation[3 * k + a] * centre[a];
    }
    for (uint32_t p = 0; p < POINTS; p++) {
        cn_point *point = &scene->points[p];
        *point = (cn_point){ .xyz = { 4 + 0.02 * p, 0, 0.1 * (p % 10) },
                             .first_observation = (uint32_t)scene->n_observations };
        for (uint32_t i = 0; i < VIEWS; i++) {
            const bool odd = i >= ODD && i < ODD + n_odd;
            const cn_view *view = &scene->views[i];
            double at[3], px[2];
            if (what != NOTHING && (odd ? p >= SEEN : p < LONELY && i > 0)) continue;
            for (int k = 0; k < 3; k++) {
                at[k] = view->translation[k];
                for (int a = 0; a < 3; a++)
                    at[k] += view->rotation[3 * k + a] * point->xyz[a];
            }
            assert_true(cn_camera_project(&scene->cameras[0], at, px));
            const double off = 0.3 + (odd && what == LARGE_ERRORS ? 2 : 0);
            scene->observations[scene->n_observations++] = (cn_observation){ i, (float)(px[0] + off), (float)px[1] };
        }
        point->n_observations = (uint32_t)scene->n_observations - point->first_observation;
    }
}

static void stay(oddity what, uint32_t n_odd)
{
    cn_scene scene;
    make(&scene, what, n_odd);
    const uint64_t n_observations = scene.n_observations;
    assert_int_equal(cn_pose_drop_outliers(&CONTEXT, &scene), CN_OK);
    assert_int_equal(scene.n_views, VIEWS);
    assert_int_equal(scene.n_points, POINTS);
    assert_int_equal(scene.n_observations, n_observations);
    assert_string_equal(logged, "");
    cn_scene_deinit(&scene);
}

/* Few points alone are no reason, nor is another side alone: a table is matched from both. With many odd views it is
 * not known which are wrong. */
static void test_right_poses_stay(void **state)
{
    (void)state;
    stay(NOTHING, 0);
    stay(FEW, 1);
    stay(OTHER_SIDE, 1);
    stay(LARGE_ERRORS, 3);
}

static void goes(oddity what, const char *says)
{
    cn_scene scene;
    make(&scene, what, 1);
    assert_int_equal(cn_pose_drop_outliers(&CONTEXT, &scene), CN_OK);
    assert_int_equal(scene.n_views, VIEWS - 1);
    for (uint32_t i = 0; i < scene.n_views; i++)
        assert_int_not_equal(scene.views[i].photo, ODD);
    /* Nothing confirms the points that it shared with one other view. */
    assert_int_equal(scene.n_points, POINTS - LONELY);
    assert_int_equal(scene.n_observations, (POINTS - LONELY) * (VIEWS - 1));
    if (!strstr(logged, says)) fail_msg("\"%s\" does not say \"%s\"", logged, says);
    cn_scene_deinit(&scene);
}

static void test_wrong_poses_go(void **state)
{
    (void)state;
    goes(LARGE_ERRORS,
         "07.jpg gets no pose: the one that was found has few sparse points (10) and large errors (2.3 px)");
    goes(FAR_AWAY, "07.jpg gets no pose: the one that was found has few sparse points (10), far from all other photos");
}

/* View `view` keeps the first n of its points. The first `alone` points, only views ODD and ODD + 1 see. */
static void leave_points(cn_scene *scene, uint32_t view, uint32_t n, uint32_t alone)
{
    uint64_t kept = 0;
    for (uint32_t p = 0; p < scene->n_points; p++) {
        cn_point *point = &scene->points[p];
        const uint64_t first = kept;
        for (uint32_t i = 0; i < point->n_observations; i++) {
            const cn_observation seen = scene->observations[(uint64_t)point->first_observation + i];
            const bool odd = seen.view == ODD || seen.view == ODD + 1;
            if ((seen.view != view || p < n) && (odd || p >= alone)) scene->observations[kept++] = seen;
        }
        point->first_observation = (uint32_t)first;
        point->n_observations = (uint32_t)(kept - first);
    }
    scene->n_observations = kept;
}

static void hold(uint32_t n_points, const cn_context *ctx, uint32_t n_left, const char *says)
{
    cn_scene scene;
    make(&scene, NOTHING, 0);
    leave_points(&scene, ODD, n_points, 0);
    assert_int_equal(cn_pose_drop_unsupported(ctx, &scene), CN_OK);
    assert_int_equal(scene.n_views, n_left);
    assert_int_equal(scene.n_points, POINTS);
    assert_string_equal(logged, says);
    cn_scene_deinit(&scene);
}

static void test_points_hold_a_pose(void **state)
{
    (void)state;
    hold(12, &CONTEXT, VIEWS, "");
    hold(11, &CONTEXT, VIEWS - 1, "07.jpg gets no pose: only 11 sparse points hold the one that was found\n");
    hold(0, NULL, VIEWS - 1, "");
}

/* View 07 has a camera of its own, whose lens has that focal length. */
static void see_through(double focal_px, uint32_t n_left, const char *says)
{
    cn_scene scene;
    make(&scene, NOTHING, 0);
    cn_camera *cameras = realloc(scene.cameras, 2 * sizeof *cameras);
    assert_non_null(cameras);
    cameras[1] = cameras[0];
    cameras[1].params[0] = cameras[1].params[1] = focal_px;
    scene.cameras = cameras;
    scene.n_cameras = 2;
    scene.views[ODD].camera = 1;
    assert_int_equal(cn_pose_drop_unsupported(&CONTEXT, &scene), CN_OK);
    assert_int_equal(scene.n_views, n_left);
    assert_string_equal(logged, says);
    cn_scene_deinit(&scene);
}

static void test_no_lens_is_that_long_or_short(void **state)
{
    (void)state;
    see_through(8900, VIEWS, "");
    see_through(9100, VIEWS - 1, "07.jpg gets no pose: no lens has the focal length that was found, 9100 px\n");
    see_through(91, VIEWS, "");
    see_through(89, VIEWS - 1, "07.jpg gets no pose: no lens has the focal length that was found, 89 px\n");
}

/* View 08 has 15 points, 5 of which only 07 sees, too. */
static void test_what_goes_takes_points_along(void **state)
{
    (void)state;
    cn_scene scene;
    make(&scene, NOTHING, 0);
    leave_points(&scene, ODD, 5, 5);
    leave_points(&scene, ODD + 1, 15, 5);
    assert_int_equal(cn_pose_drop_unsupported(&CONTEXT, &scene), CN_OK);
    assert_int_equal(scene.n_views, VIEWS - 2);
    assert_int_equal(scene.n_points, POINTS - 5);
    assert_non_null(strstr(logged, "07.jpg gets no pose: only 5 sparse points"));
    assert_non_null(strstr(logged, "08.jpg gets no pose: only 10 sparse points"));
    cn_scene_deinit(&scene);
}

/* Where hardly any pose would be left, it is not known which are wrong. */
static void test_few_poses_stay(void **state)
{
    (void)state;
    cn_scene scene;
    make(&scene, NOTHING, 0);
    for (uint32_t p = SEEN; p < POINTS; p++)
        scene.points[p].n_observations = 1;
    assert_int_equal(cn_pose_drop_unsupported(&CONTEXT, &scene), CN_OK);
    assert_int_equal(scene.n_views, VIEWS);
    assert_int_equal(scene.n_points, POINTS);
    assert_string_equal(logged, "");
    cn_scene_deinit(&scene);
}

static void test_little_is_left_alone(void **state)
{
    (void)state;
    cn_scene scene;
    make(&scene, LARGE_ERRORS, 1);
    scene.n_views = 9;
    scene.n_points = 0;
    assert_int_equal(cn_pose_drop_outliers(&CONTEXT, &scene), CN_OK);
    assert_int_equal(scene.n_views, 9);
    scene.n_views = VIEWS;
    assert_int_equal(cn_pose_drop_outliers(&CONTEXT, &scene), CN_OK);
    assert_int_equal(scene.n_views, VIEWS);
    cn_scene_deinit(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_right_poses_stay),
        cmocka_unit_test(test_wrong_poses_go),
        cmocka_unit_test(test_little_is_left_alone),
        cmocka_unit_test(test_points_hold_a_pose),
        cmocka_unit_test(test_no_lens_is_that_long_or_short),
        cmocka_unit_test(test_what_goes_takes_points_along),
        cmocka_unit_test(test_few_poses_stay),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
