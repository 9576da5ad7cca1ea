#include "align_city.h"

#include "base/units.h"
#include "pose/scene.h"
#include "pose/similarity.h"

#include <stdio.h>
#include <stdlib.h>

static void test_similarity_with_outliers(void **state)
{
    (void)state;
    double source[N][3], target[N][3], r[9];
    cn_similarity similarity;
    bool inlier[N];
    cn_quat_to_mat3(QUATERNION, r);
    for (int i = 0; i < N; i++) {
        for (int k = 0; k < 3; k++)
            source[i][k] = 10.0 * uniform(3 * i + k);
        cn_mat3_vec(r, source[i], target[i]);
        for (int k = 0; k < 3; k++)
            target[i][k] = SCALE * target[i][k] + SHIFT[k];
        if (i % 3 == 0) target[i][i % 2] += 60.0 + i;
    }
    assert_int_equal(
        cn_pose_fit_similarity(&(cn_similarity_task){ N, source, target, 1.0, 1, 9, NULL }, &similarity, inlier),
        CN_OK);
    assert_true(fabs(similarity.scale - SCALE) < 1e-9);
    for (int i = 0; i < 9; i++)
        assert_true(fabs(similarity.rotation[i] - r[i]) < 1e-9);
    for (int k = 0; k < 3; k++)
        assert_true(fabs(similarity.translation[k] - SHIFT[k]) < 1e-8);
    for (int i = 0; i < N; i++)
        assert_int_equal(inlier[i], i % 3 != 0);
    assert_int_equal(
        cn_pose_fit_similarity(&(cn_similarity_task){ N, source, target, 1.0, 1, 9, NULL }, &similarity, NULL), CN_OK);
}

static void test_similarity_refused(void **state)
{
    (void)state;
    double source[N][3], line[N][3], place[N][3] = { { 0 } };
    cn_similarity similarity;
    for (int i = 0; i < N; i++)
        for (int k = 0; k < 3; k++) {
            source[i][k] = uniform(3 * i + k);
            line[i][k] = i * (k + 1.0);
        }
    assert_int_equal(
        cn_pose_fit_similarity(&(cn_similarity_task){ 2, source, source, 1, 1, 1, NULL }, &similarity, NULL),
        CN_ERR_DATA);
    assert_int_equal(
        cn_pose_fit_similarity(&(cn_similarity_task){ 0, source, source, 1, 1, 1, NULL }, &similarity, NULL),
        CN_ERR_DATA);
    assert_int_equal(cn_pose_fit_similarity(&(cn_similarity_task){ N, line, line, 1, 1, 1, NULL }, &similarity, NULL),
                     CN_ERR_DATA);
    assert_int_equal(cn_pose_fit_similarity(&(cn_similarity_task){ N, source, line, 1, 1, 1, NULL }, &similarity, NULL),
                     CN_ERR_DATA);
    assert_int_equal(cn_pose_fit_similarity(&(cn_similarity_task){ N, place, place, 1, 1, 1, NULL }, &similarity, NULL),
                     CN_ERR_DATA);
    source[3][1] = NAN;
    assert_int_equal(
        cn_pose_fit_similarity(&(cn_similarity_task){ N, source, source, 1, 1, 1, NULL }, &similarity, NULL),
        CN_ERR_DATA);
}

/* Camera centres where they were, up to the constant that the mean makes, and right side up. */
static void check_aligned(const city *c, double tolerance)
{
    double offset[3], centre[3];
    cn_view_centre(&c->scene.views[0], offset);
    for (int k = 0; k < 3; k++)
        offset[k] -= c->truth[0][k];
    for (int i = 0; i < N; i++) {
        cn_view_centre(&c->scene.views[i], centre);
        for (int k = 0; k < 3; k++)
            assert_true(fabs(centre[k] - offset[k] - c->truth[i][k]) < tolerance);
    }
}

static void check_kind(view_kind kind, bool line, bool turning)
{
    city c;
    cn_frame frame;
    double r[9];
    make_city(&c, kind, line, turning);
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    assert_true(frame.georeferenced);
    assert_int_equal(frame.n_inliers, N);
    assert_true(fabs(frame.scale - SCALE) < 1e-2);
    assert_true(frame.residual_horizontal_m < 0.02 && frame.residual_vertical_m < 0.02);
    check_aligned(&c, 0.05);
    aim(kind, kind == SIDEWAYS ? 1.5707963 : 0.0, r);
    for (int k = 0; k < 9; k++)
        assert_true(fabs(c.scene.views[0].rotation[k] - r[k]) < 0.01);
    assert_int_equal(frame.nadir_ambiguous, kind == NADIR);
    double back[3], centre[3];
    cn_view_centre(&c.scene.views[3], centre);
    assert_int_equal(cn_frame_to_geodetic(&frame, centre, back), CN_OK);
    assert_true(fabs(back[0] - c.photos[3].latitude_deg) < 1e-6);
    cn_scene_deinit(&c.scene);
}

static void test_area(void **state)
{
    (void)state;
    check_kind(STREET, false, true);
    check_kind(NADIR, false, true);
}

/* On a line the turn about it comes from how the cameras are held. */
static void test_lines(void **state)
{
    (void)state;
    check_kind(STREET, true, true);
    check_kind(STREET, true, false);
    check_kind(SIDEWAYS, true, false);
    check_kind(NADIR, true, true);
    check_kind(NADIR, true, false);
}

static void test_gps_outliers(void **state)
{
    (void)state;
    city c;
    cn_frame frame;
    make_city(&c, STREET, false, true);
    for (int i = 0; i < N; i += 4)
        c.photos[i].latitude_deg += 0.002 * (1 + i);
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    assert_int_equal(frame.n_inliers, N - N / 4);
    assert_int_equal(frame.n_gps, N);
    check_aligned(&c, 0.05);
    cn_scene_deinit(&c.scene);
}

/* How far the scene's up is from local z, in radians: that of photo i, which was level. */
static double tilt_of(const city *c, view_kind kind, int i)
{
    const double *r = c->scene.views[i].rotation;
    return acos(fmin(fmax(kind == NADIR ? -r[8] : -r[5], -1), 1));
}

/* GPS on another continent, and an altitude that is nonsense, move neither the origin nor up. */
static void test_gps_far_away(void **state)
{
    (void)state;
    city c;
    cn_frame frame;
    double lowest_m = INFINITY, highest_m = -INFINITY;
    make_city(&c, STREET, false, true);
    for (int i = 0; i < N; i++) {
        lowest_m = fmin(lowest_m, c.photos[i].altitude_m);
        highest_m = fmax(highest_m, c.photos[i].altitude_m);
    }
    c.photos[3].latitude_deg = 40.7;
    c.photos[3].longitude_deg = -74;
    c.photos[7].altitude_m = 20000;
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    assert_int_equal(frame.n_inliers, N - 2);
    assert_int_equal(frame.n_gps, N);
    assert_true(fabs(frame.latitude_deg - 10) < 0.001);
    assert_true(fabs(fabs(frame.longitude_deg) - 180) < 0.001);
    const double above_sea_m = frame.height_m - frame.geoid_height_m;
    assert_true(above_sea_m > lowest_m && above_sea_m < highest_m);
    assert_true(frame.residual_vertical_m < 0.02);
    for (int i = 0; i < N; i++)
        assert_true(tilt_of(&c, STREET, i) < 0.001);
    check_aligned(&c, 0.05);
    cn_scene_deinit(&c.scene);
}

/* A flight whose GPS is bad: heights rise by 110 m while the receiver warms up, and places are off by about 10 m. Those
 * of the photos whose errors fit a turned scene do not decide where up is. */
static void test_gps_that_drifts(void **state)
{
    (void)state;
    city c;
    cn_frame frame;
    double place_m = 0, highest_m = 0, centre[3], mean[3] = { 0 }, truth[3] = { 0 };
    make_city(&c, NADIR, false, true);
    for (int i = 0; i < N; i++) {
        const double off[3] = { 10 * uniform(400 + i), 10 * uniform(500 + i), 110.0 * i / N };
        double at[3];
        for (int k = 0; k < 3; k++)
            at[k] = c.truth[i][k] + off[k];
        place_photo(&c, i, at);
        highest_m = fmax(highest_m, c.photos[i].altitude_m);
    }
    c.photos[7].altitude_m = 20000;
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    assert_true(frame.georeferenced);
    assert_true(frame.height_m - frame.geoid_height_m < highest_m);
    assert_true(frame.n_inliers < 0.6 * N); /* the poses stay in doubt: import checks and attempts go by that */
    for (int i = 0; i < N; i++)
        assert_true(tilt_of(&c, NADIR, i) < 0.01);
    assert_true(fabs(frame.scale - SCALE) < 0.1 * SCALE);
    for (int i = 0; i < N; i++) {
        cn_view_centre(&c.scene.views[i], centre);
        for (int k = 0; k < 3; k++) {
            mean[k] += centre[k] / N;
            truth[k] += c.truth[i][k] / N;
        }
    }
    for (int i = 0; i < N; i++) {
        cn_view_centre(&c.scene.views[i], centre);
        for (int k = 0; k < 2; k++)
            place_m = fmax(place_m, fabs((centre[k] - mean[k]) - (c.truth[i][k] - truth[k])));
    }
    assert_true(place_m < 10);
    cn_scene_deinit(&c.scene);
}

/* Heights that are off by metres tilt a scene that is tens of metres wide. Cameras that are held level say more; where
 * heights are good, they decide, although the cameras are held askew. */
static void test_up_by_the_better(void **state)
{
    (void)state;
    for (int heights_are_good = 0; heights_are_good < 2; heights_are_good++) {
        city c;
        cn_frame frame;
        make_city(&c, STREET, false, true);
        for (int i = 0; i < N; i++) {
            const double roll = heights_are_good ? 0.1 * uniform(300 + i) + 0.05 : 0,
                         askew[9] = { cos(roll), sin(roll), 0, -sin(roll), cos(roll), 0, 0, 0, 1 };
            double at[3] = { c.truth[i][0], c.truth[i][1], c.truth[i][2] + (heights_are_good ? 0 : i / 4.0) };
            turn_view(&c.scene.views[i], askew);
            place_photo(&c, i, at);
        }
        assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
        assert_true(frame.georeferenced);
        if (heights_are_good)
            check_aligned(&c, 0.05);
        else
            for (int i = 0; i < N; i++)
                assert_true(tilt_of(&c, STREET, i) < 0.01);
        cn_scene_deinit(&c.scene);
    }
}

/* Where GPS is exact, a few photos that are held askew nearly alike do not outvote it. */
static void test_few_photos_held_askew(void **state)
{
    (void)state;
    enum { FEW = 8 };
    city c;
    cn_frame frame;
    bool keep[N] = { 0 };
    make_city(&c, STREET, false, true);
    for (int i = 0; i < FEW; i++) {
        const double roll = 0.035 + 0.015 * uniform(300 + i),
                     askew[9] = { cos(roll), sin(roll), 0, -sin(roll), cos(roll), 0, 0, 0, 1 };
        turn_view(&c.scene.views[i], askew);
        keep[i] = true;
    }
    assert_int_equal(cn_scene_keep_views(&c.scene, keep), CN_OK);
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    assert_int_equal(frame.n_inliers, FEW);
    assert_true(frame.residual_vertical_m < 0.001);
    cn_scene_deinit(&c.scene);
}

static char logged[2048];
static void note(void *user, cn_log_level level, const char *text)
{
    (void)user;
    if (level == CN_LOG_WARN) snprintf(logged + strlen(logged), sizeof logged - strlen(logged), "%s\n", text);
}

static void stays_local(city *c, const char *says)
{
    const cn_context ctx = { .log = note };
    cn_frame frame;
    double before[3], after[3];
    logged[0] = '\0';
    cn_view_centre(&c->scene.views[5], before);
    assert_int_equal(cn_align(&ctx, &c->scene, &c->index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    assert_false(frame.georeferenced);
    assert_true(frame.scale == 1.0 && frame.residual_horizontal_m == 0.0);
    assert_non_null(strstr(logged, says));
    /* It is only turned and moved, as the frame says. */
    cn_view_centre(&c->scene.views[5], after);
    for (int k = 0; k < 3; k++)
        assert_true(fabs(cn_dot3(frame.rotation + 3 * k, before) + frame.translation[k] - after[k]) < 1e-9);
    cn_scene_deinit(&c->scene);
}

static void test_no_georeference(void **state)
{
    (void)state;
    city c;
    make_city(&c, STREET, false, true);
    for (int i = 2; i < N; i++)
        c.photos[i].has_gps = false;
    stays_local(&c, "2 posed photos");
    make_city(&c, STREET, false, true);
    for (int i = 0; i < N; i++) {
        c.photos[i].latitude_deg = c.photos[0].latitude_deg;
        c.photos[i].longitude_deg = c.photos[0].longitude_deg;
        c.photos[i].altitude_m = 3.0;
    }
    stays_local(&c, "one place");
    make_city(&c, STREET, false, true);
    c.photos[3].latitude_deg = 95.0;
    stays_local(&c, "not a place on Earth");
    make_city(&c, STREET, false, true);
    for (int i = 0; i < N; i++)
        c.scene.views[i].photo = UINT32_MAX;
    stays_local(&c, "0 posed photos");
}

static void test_no_altitude(void **state)
{
    (void)state;
    city c;
    cn_frame frame;
    make_city(&c, STREET, false, true);
    for (int i = 0; i < N; i++)
        c.photos[i].has_altitude = false;
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    assert_true(frame.georeferenced && !frame.geoid_applied);
    assert_true(fabs(frame.height_m) < 1e-9);
    /* The synthetic city's cameras are up to 4 m from one level. */
    assert_true(fabs(frame.scale - SCALE) < 0.001 * SCALE);
    assert_true(frame.residual_horizontal_m < 0.02 && frame.residual_vertical_m < 4.0);
    for (int i = 0; i < N; i++)
        assert_true(tilt_of(&c, STREET, i) < 0.01);
    cn_scene_deinit(&c.scene);
}

/* Photos without altitude count by their place, however few others have one: else these poses would be in doubt. */
static void test_some_altitudes(void **state)
{
    (void)state;
    city c;
    cn_frame frame;
    make_city(&c, STREET, false, true);
    for (int i = 0; i < N; i++)
        c.photos[i].has_altitude = i % 4 == 0;
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    assert_int_equal(frame.n_gps, N);
    assert_int_equal(frame.n_inliers, N);
    assert_true(frame.residual_vertical_m < 0.02);
    check_aligned(&c, 0.05);
    cn_scene_deinit(&c.scene);
    make_city(&c, STREET, false, true);
    for (int i = 0; i < N; i++)
        c.photos[i].has_altitude = i % 4 == 0;
    c.photos[5].latitude_deg += 0.002;
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    assert_int_equal(frame.n_inliers, N - 1);
    check_aligned(&c, 0.05);
    cn_scene_deinit(&c.scene);
}

/* A pair without height tells the place as any other: here those alone are exact. */
static void test_pairs_without_height(void **state)
{
    (void)state;
    double source[N][3], target[N][3], r[9];
    cn_similarity similarity;
    bool inlier[N], has_height[N];
    cn_quat_to_mat3(QUATERNION, r);
    for (int i = 0; i < N; i++) {
        for (int k = 0; k < 3; k++)
            source[i][k] = 10.0 * uniform(3 * i + k);
        cn_mat3_vec(r, source[i], target[i]);
        for (int k = 0; k < 3; k++)
            target[i][k] = SCALE * target[i][k] + SHIFT[k];
        has_height[i] = i % 4 == 0;
        if (has_height[i]) target[i][0] += 0.5 * uniform(700 + i);
        if (!has_height[i]) target[i][2] = 0;
    }
    const cn_similarity_task task = { N, source, target, 2.0, 1, 9, has_height };
    assert_int_equal(cn_pose_fit_similarity(&task, &similarity, inlier), CN_OK);
    assert_int_equal(cn_similarity_count(inlier, N), N);
    assert_true(fabs(similarity.scale - SCALE) < 0.01);
    assert_true(fabs(similarity.translation[0] - SHIFT[0]) < 0.1);
    memset(has_height, 0, sizeof has_height);
    has_height[3] = has_height[7] = true;
    assert_int_equal(cn_pose_fit_similarity(&task, &similarity, NULL), CN_ERR_DATA);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_similarity_with_outliers),
        cmocka_unit_test(test_similarity_refused),
        cmocka_unit_test(test_area),
        cmocka_unit_test(test_lines),
        cmocka_unit_test(test_gps_outliers),
        cmocka_unit_test(test_gps_far_away),
        cmocka_unit_test(test_gps_that_drifts),
        cmocka_unit_test(test_up_by_the_better),
        cmocka_unit_test(test_few_photos_held_askew),
        cmocka_unit_test(test_no_georeference),
        cmocka_unit_test(test_no_altitude),
        cmocka_unit_test(test_some_altitudes),
        cmocka_unit_test(test_pairs_without_height),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
