/* Bundle adjustment with priors: planted poses are found again, whatever the lens. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/rng.h"
#include "base/units.h"
#include "bridge/ceres.h"
#include "conurb/pose.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { N_POSES = 12, N_POINTS = 80, N_SEEN = N_POSES * N_POINTS, LENSES = 7 };

static cn_adjust_camera camera;
static cn_adjust_pose poses[N_POSES], true_poses[N_POSES];
static cn_adjust_point points[N_POINTS], true_points[N_POINTS];
static cn_adjust_observation seen[N_SEEN];
static cn_adjust_problem problem;

/* The same lens parameters for every test: a wide lens with some distortion. */
static void plant_camera(int lens)
{
    static const double PARAMS[LENSES][8] = { { 500, 320, 240 },
                                              { 500, 510, 320, 240 },
                                              { 500, 320, 240, -0.05 },
                                              { 500, 320, 240, -0.05, 0.01 },
                                              { 500, 510, 320, 240, -0.05, 0.01, 0.001, -0.002 },
                                              { 300, 305, 320, 240, 0.02, -0.01, 0.003, -0.001 },
                                              { 1600, 800 } };
    camera = (cn_adjust_camera){ .lens = lens < 6 ? lens : CN_ADJUST_SPHERE, .fixed = CN_ADJUST_ALL_FIXED };
    memcpy(camera.params, PARAMS[lens], sizeof PARAMS[lens]);
}

static double chance(uint32_t i, uint32_t k)
{
    return 2.0 * cn_rng_float(7, i, k) - 1.0;
}

static void set_centre(cn_adjust_pose *pose, const double centre[3])
{
    cn_mat3_vec(pose->rotation, centre, pose->translation);
    for (int k = 0; k < 3; k++)
        pose->translation[k] = -pose->translation[k];
}

static void centre_of(const cn_adjust_pose *pose, double centre[3])
{
    cn_mat3_tvec(pose->rotation, pose->translation, centre);
    for (int k = 0; k < 3; k++)
        centre[k] = -centre[k];
}

/* A camera on a ring of 20 m, looking inwards. */
static void plant_pose(uint32_t i)
{
    const double turn = 2.0 * CN_PI * i / N_POSES, centre[3] = { 20 * cos(turn), 20 * sin(turn), 3 + (double)(i % 3) };
    double z[3] = { -centre[0], -centre[1], 2 - centre[2] }, up[3] = { 0, 0, 1 }, x[3], y[3];
    cn_normalize3(z);
    cn_cross3(z, up, x);
    cn_normalize3(x);
    cn_cross3(z, x, y);
    true_poses[i] = (cn_adjust_pose){ 0 };
    memcpy(true_poses[i].rotation, x, sizeof x);
    memcpy(true_poses[i].rotation + 3, y, sizeof y);
    memcpy(true_poses[i].rotation + 6, z, sizeof z);
    set_centre(&true_poses[i], centre);
}

static void observe(void)
{
    const cn_camera lens = { .lens = (cn_lens)camera.lens, .width = 640, .height = 480 };
    cn_camera with = lens;
    memcpy(with.params, camera.params, sizeof with.params);
    problem.n_observations = 0;
    for (uint32_t i = 0; i < N_POSES; i++)
        for (uint32_t p = 0; p < N_POINTS; p++) {
            double cam[3], xy[2];
            cn_mat3_vec(true_poses[i].rotation, true_points[p].xyz, cam);
            for (int k = 0; k < 3; k++)
                cam[k] += true_poses[i].translation[k];
            assert_true(cn_camera_project(&with, cam, xy));
            seen[problem.n_observations++] = (cn_adjust_observation){ i, p, (float)xy[0], (float)xy[1], 1.0f };
        }
}

/* The truth, and a start away from it: everything 3 % too large, turned, moved, and each pose off by chance. */
static void plant(int lens)
{
    const double turn[4] = { cos(0.02), 0, 0, sin(0.02) };
    double whole[9], inverse[9], moved[3], mixed[9];
    plant_camera(lens);
    cn_quat_to_mat3(turn, whole);
    cn_mat3_transpose(whole, inverse);
    for (uint32_t i = 0; i < N_POSES; i++)
        plant_pose(i);
    for (uint32_t p = 0; p < N_POINTS; p++)
        for (uint32_t k = 0; k < 3; k++)
            true_points[p].xyz[k] = 6.0 * chance(p, k) + (k == 2 ? 3 : 0);
    problem = (cn_adjust_problem){ &camera, poses, points, seen, 1, N_POSES, N_POINTS, 0 };
    observe();
    for (uint32_t i = 0; i < N_POSES; i++) {
        double centre[3];
        poses[i] = true_poses[i];
        centre_of(&true_poses[i], centre);
        memcpy(poses[i].place, centre, sizeof centre);
        cn_mat3_vec(whole, centre, moved);
        for (uint32_t k = 0; k < 3; k++)
            moved[k] = 1.03 * moved[k] + 0.4 + 0.1 * chance(1000 + i, k);
        const double wobble[4] = { 1, 0.01 * chance(2000 + i, 0), 0.01 * chance(2000 + i, 1), 0.01 };
        double small[9];
        cn_quat_to_mat3(wobble, small);
        cn_mat3_mul(true_poses[i].rotation, inverse, mixed);
        cn_mat3_mul(small, mixed, poses[i].rotation);
        set_centre(&poses[i], moved);
    }
    for (uint32_t p = 0; p < N_POINTS; p++) {
        points[p] = (cn_adjust_point){ 0 };
        cn_mat3_vec(whole, true_points[p].xyz, moved);
        for (uint32_t k = 0; k < 3; k++)
            points[p].xyz[k] = 1.03 * moved[k] + 0.4 + 0.1 * chance(3000 + p, k);
    }
}

static void give_places(double sigma)
{
    for (int i = 0; i < N_POSES; i++)
        for (int k = 0; k < 3; k++)
            poses[i].place_sigma[k] = sigma;
}

static double worst_centre(void)
{
    double worst = 0, a[3], b[3];
    for (int i = 0; i < N_POSES; i++) {
        centre_of(&poses[i], a);
        centre_of(&true_poses[i], b);
        worst = fmax(worst, cn_distance3(a, b));
    }
    return worst;
}

static cn_adjust_result adjust(const cn_adjust_options *options)
{
    const cn_adjust_options fallback = cn_adjust_options_default();
    cn_adjust_result result;
    assert_int_equal(cn_ceres_adjust(NULL, &problem, options ? options : &fallback, &result), CN_OK);
    return result;
}

static void test_every_lens(void **state)
{
    (void)state;
    for (int lens = 0; lens < LENSES; lens++) {
        plant(lens);
        assert_true(worst_centre() > 0.5);
        give_places(0.05);
        const cn_adjust_result result = adjust(NULL);
        assert_true(result.converged && result.cost < result.cost_before && result.n_behind == 0);
        if (!(worst_centre() < 1e-3)) fail_msg("lens %d: %g m off", lens, worst_centre());
        for (int i = 0; i < N_POSES; i++)
            for (int k = 0; k < 9; k++)
                assert_true(fabs(poses[i].rotation[k] - true_poses[i].rotation[k]) < 1e-4);
    }
}

/* Pictures alone agree with any place and scale. */
static void test_without_priors(void **state)
{
    (void)state;
    plant(CN_LENS_OPENCV);
    adjust(NULL);
    assert_true(worst_centre() > 0.3);
}

/* Control points alone give place, turn and scale. */
static void test_control_points(void **state)
{
    (void)state;
    plant(CN_LENS_RADIAL);
    for (int p = 0; p < 5; p++)
        for (int k = 0; k < 3; k++) {
            points[p].place[k] = true_points[p].xyz[k];
            points[p].place_sigma[k] = 0.01;
        }
    adjust(NULL);
    assert_true(worst_centre() < 2e-3);
}

/* One axis may have a prior, and others none. One wrong GPS among good ones hardly counts. */
static void test_axes_and_outliers(void **state)
{
    (void)state;
    plant(CN_LENS_RADIAL);
    give_places(0.05);
    poses[3].place[0] += 40;
    for (int i = 0; i < N_POSES; i += 2)
        poses[i].place_sigma[2] = 0;
    poses[2].place[2] = NAN;
    adjust(NULL);
    assert_true(worst_centre() < 0.01);
    cn_adjust_options squares = cn_adjust_options_default();
    squares.place_sigmas = 0;
    plant(CN_LENS_RADIAL);
    give_places(0.05);
    poses[3].place[0] += 40;
    adjust(&squares);
    assert_true(worst_centre() > 0.5);
}

static void test_lens_is_found(void **state)
{
    (void)state;
    plant(CN_LENS_SIMPLE_RADIAL);
    give_places(0.05);
    camera.params[0] = 480;
    camera.params[3] = 0;
    camera.fixed = 1u << 1 | 1u << 2;
    adjust(NULL);
    assert_true(fabs(camera.params[0] - 500) < 0.05 && fabs(camera.params[3] + 0.05) < 1e-4);
    assert_true(camera.params[1] == 320 && camera.params[2] == 240);
}

/* A principal point is found as far as what was known of it allows. */
static void test_lens_prior(void **state)
{
    (void)state;
    static const double SIGMA[2] = { 1000, 1e-4 };
    for (int k = 0; k < 2; k++) {
        plant(CN_LENS_SIMPLE_RADIAL);
        give_places(0.01);
        camera.fixed = 1u | 8u;
        camera.params[1] += 3;
        camera.params[2] -= 2;
        camera.sigma[1] = camera.sigma[2] = SIGMA[k];
        adjust(NULL);
        const double left = k ? 1.0 : 0.0; /* of the error at the start */
        assert_true(fabs(camera.params[1] - 320 - 3 * left) < 0.1);
        assert_true(fabs(camera.params[2] - 240 + 2 * left) < 0.1);
    }
}

static void test_fixed_stays(void **state)
{
    (void)state;
    plant(CN_LENS_RADIAL);
    const cn_adjust_camera lens = camera;
    const cn_adjust_point point = points[4];
    for (int i = 0; i < 4; i++) {
        memcpy(poses[i].rotation, true_poses[i].rotation, sizeof poses[i].rotation);
        memcpy(poses[i].translation, true_poses[i].translation, sizeof poses[i].translation);
        poses[i].fixed = true;
    }
    points[4].fixed = true;
    adjust(NULL);
    assert_true(worst_centre() < 5e-3);
    for (int i = 0; i < 4; i++)
        assert_memory_equal(poses[i].translation, true_poses[i].translation, sizeof poses[i].translation);
    assert_memory_equal(points[4].xyz, point.xyz, sizeof point.xyz);
    assert_memory_equal(&camera, &lens, sizeof lens);
}

static void test_same_bytes(void **state)
{
    (void)state;
    cn_adjust_pose first[N_POSES];
    plant(CN_LENS_OPENCV);
    give_places(0.05);
    adjust(NULL);
    memcpy(first, poses, sizeof first);
    plant(CN_LENS_OPENCV);
    give_places(0.05);
    adjust(NULL);
    assert_memory_equal(first, poses, sizeof first);
}

static cn_status try(const cn_context *ctx, const cn_adjust_options *options)
{
    cn_adjust_result result;
    return cn_ceres_adjust(ctx, &problem, options, &result);
}

static int n_told;
static void count(void *user, const cn_progress_report *report)
{
    (void)user;
    assert_string_equal(report->stage, "poses");
    assert_true(report->done <= report->total);
    n_told++;
}

static void test_stop_and_progress(void **state)
{
    (void)state;
    cn_adjust_pose before[N_POSES];
    cn_adjust_options options = cn_adjust_options_default();
    int stop = 0;
    const cn_context ctx = { .progress = count, .stop = &stop };
    options.stage = "poses";
    plant(CN_LENS_RADIAL);
    give_places(0.05);
    memcpy(before, poses, sizeof before);
    cn_stop(&stop);
    assert_int_equal(try(&ctx, &options), CN_ERR_INTERRUPTED);
    assert_memory_equal(before, poses, sizeof before);
    stop = 0;
    n_told = 0;
    assert_int_equal(try(&ctx, &options), CN_OK);
    assert_true(n_told > 1);
}

static void test_faults(void **state)
{
    (void)state;
    cn_adjust_options options = cn_adjust_options_default();
    plant(CN_LENS_RADIAL);
    options.max_bytes = 1000;
    assert_int_equal(try(NULL, &options), CN_ERR_NOMEM);
    options.max_bytes = 0;
    seen[5].point = N_POINTS;
    assert_int_equal(try(NULL, &options), CN_ERR_DATA);
    seen[5].point = 5;
    seen[5].x_px = NAN;
    assert_int_equal(try(NULL, &options), CN_ERR_DATA);
    plant(CN_LENS_RADIAL);
    poses[1].place_sigma[0] = -1;
    assert_int_equal(try(NULL, &options), CN_ERR_DATA);
    plant(CN_LENS_RADIAL);
    points[1].xyz[0] = INFINITY;
    assert_int_equal(try(NULL, &options), CN_ERR_DATA);
    plant(CN_LENS_RADIAL);
    camera.lens = 7;
    assert_int_equal(try(NULL, &options), CN_ERR_DATA);
    plant(CN_LENS_RADIAL);
    problem.n_poses = 0;
    assert_int_equal(try(NULL, &options), CN_ERR_DATA);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_every_lens),        cmocka_unit_test(test_without_priors),
        cmocka_unit_test(test_control_points),    cmocka_unit_test(test_axes_and_outliers),
        cmocka_unit_test(test_lens_prior),        cmocka_unit_test(test_lens_is_found),
        cmocka_unit_test(test_fixed_stays),       cmocka_unit_test(test_same_bytes),
        cmocka_unit_test(test_stop_and_progress), cmocka_unit_test(test_faults),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
