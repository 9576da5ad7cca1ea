#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "ground.h"
#include "math/linalg.h"

#include <stdlib.h>
#include <string.h>

#define assert_near(value, want, tolerance) assert_true(fabs((double)(value) - (want)) <= (tolerance))

static void an_orbit_looks_at_its_middle(void **state)
{
    (void)state;
    synthetic_ground ground = { .slope = 0.5 };
    cn_frame frame = synthetic_frame(false);
    cn_path_options options = synthetic_options(&frame, &ground);
    options.n_frames = 36;
    cn_path path;
    assert_int_equal(cn_path_orbit(&path, "10,20,30,40", &options), CN_OK);
    assert_int_equal(path.n_frames, 36);
    for (uint32_t i = 0; i < 36; i++) {
        const double middle[3] = { 10, 20, 5 };
        double c[3], there[3];
        const cn_view *v = &path.frames[i].view;
        cn_view_centre(v, c);
        assert_near(hypot(c[0] - 10, c[1] - 20), 30, 1e-9);
        assert_near(c[2], 45, 1e-9); /* above the ground in the middle, not below the camera */
        cn_mat3_vec(v->rotation, middle, there);
        for (int k = 0; k < 2; k++)
            assert_near(there[k] + v->translation[k], 0, 1e-9);
        assert_true(there[2] + v->translation[2] > 0);
    }
    double first[3], ninth[3];
    cn_view_centre(&path.frames[0].view, first);
    cn_view_centre(&path.frames[9].view, ninth);
    assert_near(first[1], -10, 1e-9); /* from the south, clockwise: a quarter on is the west */
    assert_near(ninth[0], -20, 1e-9);
    cn_path_deinit(&path);
}

static void an_orbit_on_earth(void **state)
{
    (void)state;
    synthetic_ground ground = { 0 };
    cn_frame frame = synthetic_frame(true);
    cn_path_options options = synthetic_options(&frame, &ground);
    cn_path path;
    double c[3];
    assert_int_equal(cn_path_orbit(&path, "50.001,8,30,40", &options), CN_OK);
    assert_int_equal(path.n_frames, 241); /* 10 s */
    cn_view_centre(&path.frames[0].view, c);
    assert_near(c[1], 111.23 - 30, 0.05);
    cn_path_deinit(&path);
    static const char *const bad[] = { "",           "50,8,30",   "50,8,0,10",   "50,8,-1,10",   "50,8,10,10,10",
                                       "95,8,10,10", "50,8,x,10", "nan,8,10,10", "50, 8,10,10 m" };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        if (cn_path_orbit(&path, bad[i], &options) != CN_ERR_USAGE) fail_msg("\"%s\" was taken", bad[i]);
    assert_non_null(strstr(cn_error_message(), "--orbit"));
    assert_int_equal(cn_path_orbit(&path, "50,7.98,30,40", &options), CN_ERR_DATA);
}

static void photos_in_their_order(void **state)
{
    (void)state;
    cn_camera camera = { .lens = CN_LENS_SIMPLE_RADIAL, .width = 200, .height = 100, .params = { 50, 100, 50, 0 } };
    char *names[] = { "p1.jpg", "p10.jpg", "p9.jpg" }; /* as a scene sorts them; flown as people do */
    cn_view views[3];
    const double x[3] = { 0, 90, 30 };
    for (int i = 0; i < 3; i++) {
        views[i] = (cn_view){ .name = names[i], .rotation = { 1, 0, 0, 0, 0, -1, 0, 1, 0 } };
        views[i].translation[0] = -x[i];
    }
    cn_scene scene = { .cameras = &camera, .n_cameras = 1, .views = views, .n_views = 3 };
    cn_frame frame = synthetic_frame(false);
    cn_path_options options = synthetic_options(&frame, NULL);
    options.n_frames = 10;
    cn_path path;
    assert_int_equal(cn_path_photos(&path, &scene, &options), CN_OK);
    for (uint32_t i = 0; i < 10; i++) {
        double c[3];
        cn_view_centre(&path.frames[i].view, c);
        if (i % 3 == 0 && i != 6) assert_near(c[0], 10.0 * i, 1e-6); /* an even speed, through the photo at 30 */
        assert_near(c[1], 0, 1e-9);
        assert_near(path.frames[i].camera.params[0], 45, 1e-9); /* the photos' field of view at 90 px */
        assert_near(path.frames[i].view.rotation[7], 1, 1e-9);
    }
    cn_path_deinit(&path);
    scene.n_views = 1;
    options.n_frames = 0;
    assert_int_equal(cn_path_photos(&path, &scene, &options), CN_OK);
    assert_int_equal(path.n_frames, 1);
    cn_path_deinit(&path);
    scene.n_views = 0;
    assert_int_equal(cn_path_photos(&path, &scene, &options), CN_ERR_DATA);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_orbit_looks_at_its_middle),
        cmocka_unit_test(an_orbit_on_earth),
        cmocka_unit_test(photos_in_their_order),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
