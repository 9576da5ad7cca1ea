#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/units.h"
#include "conurb/pose.h"
#include "pose/lens.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const cn_camera CAMERAS[] = {
    { 1, CN_LENS_SIMPLE_PINHOLE, 640, 480, { 500, 320, 240 } },
    { 2, CN_LENS_PINHOLE, 640, 480, { 500, 510, 310, 245 } },
    { 3, CN_LENS_SIMPLE_RADIAL, 640, 480, { 500, 320, 240, -0.12 } },
    { 4, CN_LENS_RADIAL, 640, 480, { 500, 320, 240, -0.2, 0.05 } },
    { 5, CN_LENS_OPENCV, 640, 480, { 500, 505, 322, 238, -0.25, 0.08, 0.002, -0.003 } },
    { 6, CN_LENS_OPENCV, 1080, 1920, { 1375.52, 1374.49, 554.558, 965.268, 0.0578421, -0.0805099, -9.8e-4, 1.5e-4 } },
    { 7, CN_LENS_OPENCV_FISHEYE, 640, 480, { 200, 201, 320, 240, 0.02, -0.004, 0.001, -0.0002 } },
    { 8, CN_LENS_EQUIRECTANGULAR, 640, 320, { 640, 320 } },
};
#define N_CAMERAS (sizeof CAMERAS / sizeof *CAMERAS)

static void test_round_trip(void **state)
{
    (void)state;
    for (size_t i = 0; i < N_CAMERAS; i++)
        for (double y = 0.5; y < CAMERAS[i].height; y += 37.0)
            for (double x = 0.5; x < CAMERAS[i].width; x += 41.0) {
                double dir[3], back[2];
                assert_int_equal(cn_camera_unproject(&CAMERAS[i], x, y, dir), CN_OK);
                assert_true(fabs(hypot(hypot(dir[0], dir[1]), dir[2]) - 1.0) < 1e-12);
                for (int k = 0; k < 3; k++)
                    dir[k] *= 7.5;
                assert_true(cn_camera_project(&CAMERAS[i], dir, back));
                assert_true(fabs(back[0] - x) < 1e-6 && fabs(back[1] - y) < 1e-6);
            }
}

/* By hand, after OpenCV's documentation. */
static void test_known_values(void **state)
{
    (void)state;
    const double xyz[3] = { 0.2, -0.1, 2.0 };
    double u = 0.1, v = -0.05, s = u * u + v * v, xy[2];
    double radial = 1 - 0.25 * s + 0.08 * s * s;
    assert_true(cn_camera_project(&CAMERAS[4], xyz, xy));
    assert_true(fabs(xy[0] - (322 + 500 * (u * radial + 2 * 0.002 * u * v - 0.003 * (s + 2 * u * u)))) < 1e-9);
    assert_true(fabs(xy[1] - (238 + 505 * (v * radial + 2 * -0.003 * u * v + 0.002 * (s + 2 * v * v)))) < 1e-9);
    double theta = atan(sqrt(s)), t2 = theta * theta;
    double distorted = theta * (1 + t2 * (0.02 + t2 * (-0.004 + t2 * (0.001 + t2 * -0.0002))));
    assert_true(cn_camera_project(&CAMERAS[6], xyz, xy));
    assert_true(fabs(xy[0] - (320 + 200 * distorted * u / sqrt(s))) < 1e-9);
    const double axis[3] = { 0, 0, 3 };
    assert_true(cn_camera_project(&CAMERAS[6], axis, xy));
    assert_true(xy[0] == 320.0 && xy[1] == 240.0);
}

static void test_fisheye_sees_180_degrees(void **state)
{
    (void)state;
    const cn_camera camera = { 1, CN_LENS_OPENCV_FISHEYE, 1000, 1000, { 300, 300, 500, 500, 0, 0, 0, 0 } };
    const double side[3] = { 2.0, 0.0, 0.0 }, behind[3] = { 1.0, 0.0, -1.0 };
    double xy[2], dir[3];
    assert_true(cn_camera_project(&camera, side, xy));
    assert_true(fabs(xy[0] - (500 + 300 * CN_PI / 2)) < 1e-9);
    assert_int_equal(cn_camera_unproject(&camera, xy[0], xy[1], dir), CN_OK);
    assert_true(fabs(dir[0] - 1.0) < 1e-12 && fabs(dir[2]) < 1e-12);
    assert_true(cn_camera_project(&camera, behind, xy));
    assert_int_equal(cn_camera_unproject(&camera, xy[0], xy[1], dir), CN_OK);
    assert_true(fabs(dir[2] + sqrt(0.5)) < 1e-9);
    /* 300 px per radian: half a turn is 942 px out, and there is nothing beyond. */
    assert_int_equal(cn_camera_unproject(&camera, 500 + 950, 500, dir), CN_ERR_DATA);
}

/* COLMAP's equirectangular camera: z in the middle, x to the right of it, -y at the top; the back at both edges. */
static void test_sphere(void **state)
{
    (void)state;
    const cn_camera camera = cn_camera_equirectangular(640, 320);
    const double dirs[5][3] = { { 0, 0, 2 }, { 2, 0, 0 }, { -2, 0, 0 }, { 1e-9, 0, -2 }, { 0, 1, 1 } };
    const double wanted[5][2] = { { 320, 160 }, { 480, 160 }, { 160, 160 }, { 640, 160 }, { 320, 240 } };
    const double zero[3] = { 0, 0, 0 }, up[3] = { 0, -3, 0 };
    double xy[2], dir[3], off[2];
    for (int i = 0; i < 5; i++) {
        assert_true(cn_camera_project(&camera, dirs[i], xy));
        assert_true(fabs(xy[0] - wanted[i][0]) < 1e-6 && fabs(xy[1] - wanted[i][1]) < 1e-6);
    }
    assert_false(cn_camera_project(&camera, zero, xy));
    assert_true(cn_camera_project(&camera, up, xy) && fabs(xy[1]) < 1e-9);
    assert_int_equal(cn_camera_unproject(&camera, 640 + 160, 160, dir), CN_OK); /* once round */
    assert_true(fabs(dir[0] + 1) < 1e-9);
    assert_int_equal(cn_camera_unproject(&camera, 10, 321, dir), CN_ERR_DATA);
    assert_int_equal(cn_camera_unproject(&camera, 10, -1, dir), CN_ERR_DATA);
    /* From edge to edge it is near, and high up a pixel is narrower. */
    assert_true(fabs(cn_camera_offset_px(&camera, (double[2]){ 639, 160 }, (double[2]){ 2, 160 }, off) - 3) < 1e-9);
    assert_true(fabs(off[0] - 3) < 1e-9);
    cn_camera_offset_px(&camera, (double[2]){ 1, 160 + 160.0 * 2 / 3 }, (double[2]){ 639, 160 }, off);
    assert_true(fabs(off[0] + 1) < 1e-9);
    assert_true(fabs(cn_camera_offset_px(&CAMERAS[1], (double[2]){ 639, 0 }, (double[2]){ 2, 0 }, off) - 637) < 1e-9);
    assert_true(cn_camera_vfov_deg(&camera) == 60);
    assert_true(fabs(cn_camera_vfov_deg(&CAMERAS[1]) - 2 * 180 / CN_PI * atan(240 / 510.0)) < 1e-9);
    assert_int_equal(cn_camera_check(&camera, "x"), CN_OK);
    const cn_camera part = { 1, CN_LENS_EQUIRECTANGULAR, 640, 320, { 1280, 640 } };
    assert_int_equal(cn_camera_check(&part, "x"), CN_ERR_FORMAT);
}

static void test_no_inverse(void **state)
{
    (void)state;
    /* r (1 - 0.5 r^2) is greatest at r = 0.8165 with 0.5443. */
    const cn_camera radial = { 9, CN_LENS_SIMPLE_RADIAL, 1000, 1000, { 500, 500, 500, -0.5 } };
    const cn_camera fisheye = { 9, CN_LENS_OPENCV_FISHEYE, 1000, 1000, { 300, 300, 500, 500, -0.3, 0, 0, 0 } };
    const cn_camera tangential = { 9, CN_LENS_OPENCV, 1000, 1000, { 500, 500, 500, 500, -0.5, 0, 0.01, 0.01 } };
    const double beyond[3] = { 0.9, 0.0, 1.0 }, within[3] = { 0.8, 0.0, 1.0 };
    double dir[3], xy[2];
    assert_int_equal(cn_camera_unproject(&radial, 500 + 0.544 * 500, 500, dir), CN_OK);
    assert_int_equal(cn_camera_unproject(&radial, 1000, 500, dir), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "SIMPLE_RADIAL"));
    assert_true(fabs(dir[0] - sqrt(0.5)) < 1e-12 && fabs(dir[2] - sqrt(0.5)) < 1e-12);
    assert_false(cn_camera_project(&radial, beyond, xy));
    assert_true(cn_camera_project(&radial, within, xy));
    assert_int_equal(cn_camera_unproject(&fisheye, 500, 500 + 400, dir), CN_ERR_DATA);
    assert_int_equal(cn_camera_unproject(&tangential, 0, 0, dir), CN_ERR_DATA);
    assert_int_equal(cn_camera_unproject(&tangential, 520, 480, dir), CN_OK);
    assert_int_equal(cn_camera_unproject(&radial, NAN, 0, dir), CN_ERR_DATA);
    assert_true(dir[2] == 1.0);
}

static void test_behind(void **state)
{
    (void)state;
    const double points[][3] = { { 0, 0, -1 }, { 1, 1, 0 }, { 0, 0, 0 }, { NAN, 0, 1 }, { 0, 0, NAN } };
    double xy[2];
    for (size_t i = 0; i < 6; i++)
        for (size_t j = 0; j < 5; j++)
            assert_false(cn_camera_project(&CAMERAS[i], points[j], xy));
    assert_false(cn_camera_project(&CAMERAS[6], points[0], xy));
}

static void test_resize(void **state)
{
    (void)state;
    for (size_t i = 0; i < N_CAMERAS; i++)
        for (int odd = 0; odd < 2; odd++) {
            cn_camera half;
            uint32_t w = CAMERAS[i].width / 2, h = CAMERAS[i].height / 2 + (odd ? 7 : 0);
            cn_camera_resize(&CAMERAS[i], w, h, &half);
            assert_int_equal(half.width, w);
            assert_int_equal(half.height, h);
            if (!odd) assert_int_equal(half.lens, CAMERAS[i].lens);
            const double xyz[3] = { 0.15, -0.2, 1.0 };
            double a[2], b[2];
            assert_true(cn_camera_project(&CAMERAS[i], xyz, a));
            assert_true(cn_camera_project(&half, xyz, b));
            assert_true(fabs(a[0] * w / CAMERAS[i].width - b[0]) < 1e-9);
            assert_true(fabs(a[1] * h / CAMERAS[i].height - b[1]) < 1e-9);
        }
}

static void test_pack(void **state)
{
    (void)state;
    for (size_t i = 0; i < N_CAMERAS; i++) {
        cn_camera copy = CAMERAS[i];
        cn_lens_view view = cn_lens_unpack(&copy);
        cn_lens_pack(&view, &copy);
        assert_memory_equal(copy.params, CAMERAS[i].params, sizeof copy.params);
        assert_int_equal(cn_lens_from_name(cn_lens_name(copy.lens)), copy.lens);
    }
    assert_int_equal(cn_lens_from_name("FOV"), -1);
}

/* A picture whose colours are where its pixels are. */
static void test_look_up(void **state)
{
    (void)state;
    enum { W = 640, H = 480 };
    float *rgbw = malloc(sizeof(float[4]) * W * H), seen[4];
    assert_non_null(rgbw);
    for (int i = 0; i < W * H; i++) {
        const float pixel[4] = { (float)(i % W), (float)(i / W), 1, i % W < 400 ? 1 : 0.5f };
        memcpy(rgbw + 4 * (size_t)i, pixel, sizeof pixel);
    }
    for (size_t i = 0; i < 5; i++) {
        double dir[3];
        assert_int_equal(cn_camera_unproject(&CAMERAS[i], 100.25 + 0.5, 50.75 + 0.5, dir), CN_OK);
        cn_camera_look_up(&CAMERAS[i], rgbw, dir, seen);
        assert_true(fabsf(seen[0] - 100.25f) < 1e-3f && fabsf(seen[1] - 50.75f) < 1e-3f && seen[3] == 1);
        assert_int_equal(cn_camera_unproject(&CAMERAS[i], 400, 200, dir), CN_OK);
        cn_camera_look_up(&CAMERAS[i], rgbw, dir, seen);
        assert_true(seen[3] == 0.5f);
        cn_camera_look_up(&CAMERAS[i], rgbw, (const double[3]){ 0, 0, -1 }, seen);
        assert_true(seen[2] == 0 && seen[3] == 0);
        cn_camera_look_up(&CAMERAS[i], rgbw, (const double[3]){ 1, 0, 0.9 }, seen);
        assert_true(seen[2] == 0 && seen[3] == 0);
    }
    free(rgbw);
}

/* COLMAP's ids of lens models that cn_lens lacks. */
enum { FULL_OPENCV = 6, FOV, SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, THIN_PRISM_FISHEYE };

static double nearest_of(int id, const double *params, cn_camera *camera)
{
    double error_px;
    *camera = (cn_camera){ .id = 1, .width = 640, .height = 480 };
    assert_int_equal(cn_lens_from_foreign(id, params, camera, "cameras.txt", &error_px), CN_OK);
    return error_px;
}

static void assert_near_pixel(const cn_camera *camera, double u, double v, const double at[2], double most_px)
{
    double px[2];
    assert_true(cn_camera_project(camera, (const double[3]){ u, v, 1 }, px));
    assert_true(hypot(px[0] - at[0], px[1] - at[1]) <= most_px);
}

/* Lenses that are one of cn_lens under another name. */
static void test_foreign_is_the_same(void **state)
{
    (void)state;
    cn_camera camera;
    double at[2];
    const cn_camera fisheye = { 1, CN_LENS_OPENCV_FISHEYE, 640, 480, { 200, 200, 320, 240, 0.02, -0.004 } },
                    opencv = { 1, CN_LENS_OPENCV, 640, 480, { 500, 505, 322, 238, -0.25, 0.08, 0.002, -0.003 } },
                    prism = { 1, CN_LENS_OPENCV_FISHEYE, 640, 480, { 200, 201, 320, 240, 0.02, -0.004, 1e-3, -2e-4 } };
    assert_true(nearest_of(RADIAL_FISHEYE, (const double[]){ 200, 320, 240, 0.02, -0.004 }, &camera) == 0);
    assert_true(cn_camera_project(&fisheye, (const double[3]){ 1.5, -0.7, 1 }, at));
    assert_near_pixel(&camera, 1.5, -0.7, at, 1e-9);
    assert_true(nearest_of(SIMPLE_RADIAL_FISHEYE, (const double[]){ 200, 320, 240, 0.02 }, &camera) == 0);
    assert_true(camera.lens == CN_LENS_OPENCV_FISHEYE && camera.params[4] == 0.02 && camera.params[5] == 0);
    const double full[12] = { 500, 505, 322, 238, -0.25, 0.08, 0.002, -0.003 };
    assert_true(nearest_of(FULL_OPENCV, full, &camera) < 1e-2);
    assert_true(cn_camera_project(&opencv, (const double[3]){ 0.5, -0.3, 1 }, at));
    assert_near_pixel(&camera, 0.5, -0.3, at, 1e-2);
    const double thin[12] = { 200, 201, 320, 240, 0.02, -0.004, 0, 0, 1e-3, -2e-4, 0, 0 };
    assert_true(nearest_of(THIN_PRISM_FISHEYE, thin, &camera) < 1e-2);
    assert_true(cn_camera_project(&prism, (const double[3]){ 1.2, -0.9, 1 }, at));
    assert_near_pixel(&camera, 1.2, -0.9, at, 1e-2);
}

/* Lenses that cn_lens comes near to, against their formulas. */
static void test_foreign_is_near(void **state)
{
    (void)state;
    cn_camera camera;
    const double full[12] = { 500, 505, 322, 238, 0.1, -0.02, 0.002, -0.003, 0.005, 0.15, 0.01, 0.001 };
    double error_px = nearest_of(FULL_OPENCV, full, &camera);
    assert_true(error_px > 0 && error_px < 0.5);
    const double u = 0.45, v = -0.35, r2 = u * u + v * v,
                 radial = (1 + 0.1 * r2 - 0.02 * r2 * r2 + 0.005 * r2 * r2 * r2) /
                          (1 + 0.15 * r2 + 0.01 * r2 * r2 + 0.001 * r2 * r2 * r2),
                 x = u * radial + 2 * 0.002 * u * v - 0.003 * (r2 + 2 * u * u),
                 y = v * radial - 2 * 0.003 * u * v + 0.002 * (r2 + 2 * v * v);
    assert_near_pixel(&camera, u, v, (const double[2]){ 500 * x + 322, 505 * y + 238 }, error_px + 1e-3);
    error_px = nearest_of(FOV, (const double[]){ 500, 500, 320, 240, 0.9 }, &camera);
    assert_true(error_px < 0.5);
    const double bent = atan(2 * 0.5 * tan(0.45)) / 0.9;
    assert_near_pixel(&camera, 0.5, 0, (const double[2]){ 500 * bent + 320, 240 }, error_px + 1e-3);
    /* A prism that is thin as in photos of a museum's court by a reflex camera. */
    const double thin[12] = { 360, 360, 320, 240, 0.21, 0.21, -5e-6, 5e-4, -0.158, 0.407, -8e-5, 9e-4 };
    error_px = nearest_of(THIN_PRISM_FISHEYE, thin, &camera);
    assert_true(error_px < 0.5);
    const double r = hypot(u, v), angle = atan(r), a = angle * u / r, b = angle * v / r, s = angle * angle,
                 grown = 1 + s * (0.21 + s * (0.21 + s * (-0.158 + s * 0.407)));
    const double px[2] = { 360 * (a * grown - 2 * 5e-6 * a * b + 5e-4 * (s + 2 * a * a) - 8e-5 * s) + 320,
                           360 * (b * grown + 2 * 5e-4 * a * b - 5e-6 * (s + 2 * b * b) + 9e-4 * s) + 240 };
    assert_near_pixel(&camera, u, v, px, error_px + 1e-3);
}

static void test_foreign_is_too_far(void **state)
{
    (void)state;
    cn_camera camera = { .id = 4, .width = 640, .height = 480 };
    double error_px;
    const double bent[12] = { 200, 200, 320, 240, 0, 0, 0.2, 0.3 }, lost[12] = { 200, NAN };
    assert_int_equal(cn_lens_from_foreign(THIN_PRISM_FISHEYE, bent, &camera, "a/cameras.txt", &error_px),
                     CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "a/cameras.txt: camera 4 has lens model THIN_PRISM_FISHEYE"));
    assert_int_equal(cn_lens_from_foreign(FOV, lost, &camera, "a", &error_px), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "finite"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_known_values),
        cmocka_unit_test(test_fisheye_sees_180_degrees),
        cmocka_unit_test(test_sphere),
        cmocka_unit_test(test_no_inverse),
        cmocka_unit_test(test_behind),
        cmocka_unit_test(test_resize),
        cmocka_unit_test(test_pack),
        cmocka_unit_test(test_look_up),
        cmocka_unit_test(test_foreign_is_the_same),
        cmocka_unit_test(test_foreign_is_near),
        cmocka_unit_test(test_foreign_is_too_far),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
