/* Models of groups become one scene near the truth: by GPS, without it, with a group missing, apart, or contradicting
 * the others; and the same bytes with any number of threads. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../../bench/pose_city.h"
#include "bridge/join.h"
#include "math/linalg.h"
#include "pose/merge.h"
#include "pose/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { N = 120, MOST = 50, MANY = 520, MOST_OF_MANY = 150 };

static pose_city city;
static cn_photo_groups groups;
static cn_scene models[16];
static cn_pose_options options;

static void make_city(uint32_t n, uint32_t most, bool has_gps)
{
    options = cn_pose_options_default();
    pose_city_make(&city, &(pose_city_options){ n, 0.5, has_gps, 8 });
    pose_city_split(&city, most, &groups);
    assert_true(groups.n >= 4 && groups.n <= 16);
    for (uint32_t g = 0; g < groups.n; g++)
        pose_city_model(&city, &groups, g, &models[g]);
}

static void make(bool has_gps)
{
    make_city(N, MOST, has_gps);
}

static void unmake(void)
{
    for (uint32_t g = 0; g < groups.n; g++)
        cn_scene_deinit(&models[g]);
    cn_photo_groups_deinit(&groups);
    pose_city_free(&city);
}

static cn_status merge(const cn_context *ctx, size_t most_bytes, cn_scene *scene, cn_frame *frame,
                       cn_merge_report *report)
{
    const cn_merge_task task = { &city.index, &groups, models, &options, most_bytes };
    return cn_groups_merge(ctx, &task, scene, frame, report);
}

static void test_at_once(void **state)
{
    (void)state;
    cn_scene scene;
    cn_frame frame;
    cn_merge_report report;
    make(true);
    assert_int_equal(merge(NULL, (size_t)1 << 30, &scene, &frame, &report), CN_OK);
    const pose_city_error e = pose_city_compare(&city, &scene, &frame);
    assert_int_equal(report.way, CN_MERGE_WHOLE);
    assert_int_equal(report.n_joined, groups.n);
    assert_true(frame.georeferenced && frame.n_gps == scene.n_views);
    assert_true(scene.n_views >= 0.95 * N);
    assert_int_equal(scene.n_cameras, 1);
    assert_true(e.fit_rms_m < 0.09);
    assert_true(e.rms_m < 0.4);
    /* The lens of each model was 0.2 % off. */
    assert_true(fabs(scene.cameras[0].params[0] / 700 - 1) < 1.5e-3);
    assert_true(cn_scene_measure_errors(&scene) < 0.7);
    for (uint32_t i = 1; i < scene.n_views; i++)
        assert_true(strcmp(scene.views[i - 1].name, scene.views[i].name) < 0);
    cn_scene_deinit(&scene);
    cn_merge_report_deinit(&report);
    unmake();
}

static void test_by_group_and_threads(void **state)
{
    (void)state;
    cn_scene scene[2];
    cn_frame frame[2];
    cn_merge_report report;
    make(true);
    for (unsigned k = 0; k < 2; k++) {
        cn_context ctx = { 0 };
        assert_int_equal(cn_pool_create(&ctx.pool, k ? 3 : 1), CN_OK);
        assert_int_equal(merge(&ctx, 0, &scene[k], &frame[k], &report), CN_OK);
        assert_int_equal(report.way, CN_MERGE_BY_GROUP);
        cn_merge_report_deinit(&report);
        cn_pool_destroy(&ctx.pool);
    }
    assert_true(pose_city_compare(&city, &scene[0], &frame[0]).fit_rms_m < 0.09);
    assert_int_equal(scene[0].n_views, scene[1].n_views);
    assert_int_equal(scene[0].n_points, scene[1].n_points);
    for (uint32_t i = 0; i < scene[0].n_views; i++) {
        assert_memory_equal(scene[0].views[i].rotation, scene[1].views[i].rotation, sizeof scene[0].views[i].rotation);
        assert_memory_equal(scene[0].views[i].translation, scene[1].views[i].translation,
                            sizeof scene[0].views[i].translation);
    }
    assert_memory_equal(scene[0].points, scene[1].points, scene[0].n_points * sizeof *scene[0].points);
    for (int k = 0; k < 2; k++)
        cn_scene_deinit(&scene[k]);
    unmake();
}

/* Above 500 photos the adjustment goes by conjugate gradients. */
static void test_many(void **state)
{
    (void)state;
    cn_scene scene;
    cn_frame frame;
    cn_merge_report report;
    make_city(MANY, MOST_OF_MANY, true);
    assert_int_equal(merge(NULL, (size_t)1 << 30, &scene, &frame, &report), CN_OK);
    assert_int_equal(report.way, CN_MERGE_WHOLE);
    assert_true(scene.n_views > 500);
    const pose_city_error e = pose_city_compare(&city, &scene, &frame);
    print_message("%u photos at once: %.4f m rms after the best similarity\n", scene.n_views, e.fit_rms_m);
    assert_true(e.fit_rms_m < 0.06);
    cn_scene_deinit(&scene);
    cn_merge_report_deinit(&report);
    unmake();
}

/* A photo that contradicts itself: it is turned, and what it sees is up to 60 px elsewhere. No pose fits it, so it has
 * none, and the others keep theirs. */
static void test_odd_photo(void **state)
{
    (void)state;
    cn_scene scene;
    cn_frame frame;
    cn_merge_report report;
    make(true);
    cn_scene *m = &models[1];
    const uint32_t v = m->n_views / 2;
    double turned[9];
    const double turn[9] = { 0.9553, -0.2955, 0, 0.2955, 0.9553, 0, 0, 0, 1 };
    cn_mat3_mul(turn, m->views[v].rotation, turned);
    memcpy(m->views[v].rotation, turned, sizeof turned);
    for (uint64_t i = 0; i < m->n_observations; i++)
        if (m->observations[i].view == v) m->observations[i].x_px += (float)(i * 37 % 121) - 60;
    char *name = strdup(m->views[v].name);
    assert_non_null(name);
    assert_int_equal(merge(NULL, (size_t)1 << 30, &scene, &frame, &report), CN_OK);
    assert_true(pose_city_compare(&city, &scene, &frame).fit_rms_m < 0.09);
    assert_true(scene.n_views >= 0.95 * N - 1);
    for (uint32_t i = 0; i < scene.n_views; i++)
        assert_string_not_equal(scene.views[i].name, name);
    free(name);
    cn_scene_deinit(&scene);
    cn_merge_report_deinit(&report);
    unmake();
}

/* Without GPS the groups are tied by what they share alone, and the unit is not the metre. */
static void test_without_gps(void **state)
{
    (void)state;
    cn_scene scene;
    cn_frame frame;
    cn_merge_report report;
    make(false);
    assert_int_equal(merge(NULL, (size_t)1 << 30, &scene, &frame, &report), CN_OK);
    assert_false(frame.georeferenced);
    assert_int_equal(report.n_joined, groups.n);
    assert_true(pose_city_compare(&city, &scene, &frame).fit_rms_m < 0.09);
    cn_scene_deinit(&scene);
    cn_merge_report_deinit(&report);
    unmake();
}

/* A group without a model costs only the photos that no other group has; one that nothing ties is placed by GPS. */
static void test_missing_and_apart(void **state)
{
    (void)state;
    cn_scene scene;
    cn_frame frame;
    cn_merge_report report;
    make(true);
    cn_scene_deinit(&models[1]);
    /* Its core alone, without observations that it shares. */
    bool keep[MOST] = { false };
    for (uint32_t i = 0; i < models[0].n_views; i++)
        for (uint32_t k = 0; k < groups.groups[0].n_core; k++)
            keep[i] = keep[i] || models[0].views[i].photo == groups.groups[0].photos[k];
    for (uint32_t g = 2; g < groups.n; g++)
        for (uint32_t i = 0; i < models[g].n_views; i++)
            for (uint32_t k = 0; k < models[0].n_views; k++)
                if (models[0].views[k].photo == models[g].views[i].photo) keep[k] = false;
    assert_int_equal(cn_scene_keep_views(&models[0], keep), CN_OK);
    assert_true(models[0].n_views >= 5);
    assert_int_equal(merge(NULL, (size_t)1 << 30, &scene, &frame, &report), CN_OK);
    assert_int_equal(report.groups[1].fate, CN_GROUP_MISSING);
    assert_int_equal(report.groups[0].fate, CN_GROUP_JOINED);
    assert_int_equal(report.groups[0].n_links, 0);
    assert_int_equal(report.n_joined, groups.n - 1);
    assert_true(pose_city_compare(&city, &scene, &frame).fit_rms_m < 0.5);
    cn_scene_deinit(&scene);
    cn_merge_report_deinit(&report);
    /* Without GPS nothing can tie it. */
    for (uint32_t i = 0; i < N; i++)
        city.index.photos[i].has_gps = false;
    assert_int_equal(merge(NULL, (size_t)1 << 30, &scene, &frame, &report), CN_OK);
    assert_int_equal(report.groups[0].fate, CN_GROUP_APART);
    cn_scene_deinit(&scene);
    cn_merge_report_deinit(&report);
    unmake();
}

static void test_no_model(void **state)
{
    (void)state;
    cn_scene scene;
    cn_frame frame;
    cn_merge_report report;
    make(true);
    for (uint32_t g = 0; g < groups.n; g++)
        cn_scene_deinit(&models[g]);
    assert_int_equal(merge(NULL, 0, &scene, &frame, &report), CN_ERR_DATA);
    assert_int_equal(scene.n_views, 0);
    assert_null(report.groups);
    unmake();
}

static void test_join_refuses(void **state)
{
    (void)state;
    cn_join_model model[2] = { { .scale = 1, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 }, .fixed = true },
                               { .scale = 1, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } } };
    cn_join_tie tie = { .a = 0, .b = 2, .sigma = 1 };
    const cn_join_problem problem = { .models = model, .ties = &tie, .n_models = 2, .n_ties = 1 };
    assert_int_equal(cn_ceres_join(NULL, &problem), CN_ERR_DATA);
    tie.b = 1;
    tie.in_a[0] = NAN;
    assert_int_equal(cn_ceres_join(NULL, &problem), CN_ERR_DATA);
    tie.in_a[0] = 5;
    assert_int_equal(cn_ceres_join(NULL, &problem), CN_OK);
    assert_true(fabs(model[1].place[0] - 5) < 1e-6);
    model[1].scale = 0;
    assert_int_equal(cn_ceres_join(NULL, &problem), CN_ERR_DATA);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_at_once),     cmocka_unit_test(test_by_group_and_threads),
        cmocka_unit_test(test_many),        cmocka_unit_test(test_odd_photo),
        cmocka_unit_test(test_without_gps), cmocka_unit_test(test_missing_and_apart),
        cmocka_unit_test(test_no_model),    cmocka_unit_test(test_join_refuses),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
