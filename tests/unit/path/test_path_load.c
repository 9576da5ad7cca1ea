#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/units.h"
#include "conurb/path.h"
#include "math/linalg.h"

#include <math.h>
#include <string.h>

#define assert_near(value, want, tolerance) assert_true(fabs((double)(value) - (want)) <= (tolerance))

static cn_status load(cn_path *path, const char *text, const cn_frame *frame)
{
    text_file_write(text);
    cn_path_options options = cn_path_options_default();
    options.frame = frame;
    options.width = 160;
    options.height = 90;
    return cn_path_load(path, text_file, &options);
}

static cn_frame local_frame(void)
{
    cn_frame frame;
    cn_frame_init(&frame);
    return frame;
}

static void check_vector(const double *v, double x, double y, double z)
{
    assert_near(v[0], x, 1e-9);
    assert_near(v[1], y, 1e-9);
    assert_near(v[2], z, 1e-9);
}

static void check_centre(const cn_path *path, uint32_t i, double x, double y, double z)
{
    double centre[3];
    cn_view_centre(&path->frames[i].view, centre);
    check_vector(centre, x, y, z);
}

static void angles_follow_the_compass(void **state)
{
    (void)state;
    cn_frame frame = local_frame();
    cn_path path;
    assert_int_equal(load(&path, "{\"keyframes\":[{\"local\":[1,2,3],\"heading_deg\":90,\"vfov_deg\":90}]}", &frame),
                     CN_OK);
    assert_int_equal(path.n_frames, 1);
    const double *r = path.frames[0].view.rotation;
    check_vector(r, 0, -1, 0);     /* right of east is south */
    check_vector(r + 3, 0, 0, -1); /* down */
    check_vector(r + 6, 1, 0, 0);  /* forward is east */
    check_centre(&path, 0, 1, 2, 3);
    assert_near(path.frames[0].camera.params[0], 45, 1e-9); /* 90 px high at 90 degrees */
    assert_int_equal(path.frames[0].camera.width, 160);
    assert_near(path.fps, 24, 0);
    cn_path_deinit(&path);
    const char *up = "{\"keyframes\":[{\"local\":[0,0,0],\"heading_deg\":0,\"pitch_deg\":30,\"roll_deg\":90}]}";
    assert_int_equal(load(&path, up, &frame), CN_OK);
    r = path.frames[0].view.rotation;
    check_vector(r + 6, 0, cos(CN_PI / 6), 0.5); /* pitch up is positive */
    check_vector(r, 0, 0.5, -cos(CN_PI / 6));    /* rolled clockwise: right points down */
    cn_path_deinit(&path);
    cn_path_deinit(&path);
}

static void look_at_puts_the_target_in_the_middle(void **state)
{
    (void)state;
    cn_frame frame = local_frame();
    cn_path path;
    const char *text = "{\"fps\":10,\"keyframes\":["
                       "{\"time_s\":0,\"local\":[0,0,10],\"look_at\":{\"local\":[20,0,0]},\"vfov_deg\":40},"
                       "{\"time_s\":1,\"local\":[10,0,10],\"look_at\":{\"local\":[20,0,0]},\"vfov_deg\":60},"
                       "{\"time_s\":3,\"local\":[20,5,10],\"look_at\":{\"local\":[20,0,0]}}]}";
    assert_int_equal(load(&path, text, &frame), CN_OK);
    assert_int_equal(path.n_frames, 31);
    for (uint32_t i = 0; i < path.n_frames; i++) {
        double target[3] = { 20, 0, 0 }, there[3], xy[2], f = path.frames[i].camera.params[0];
        const cn_view *v = &path.frames[i].view;
        cn_mat3_vec(v->rotation, target, there);
        for (int k = 0; k < 3; k++)
            there[k] += v->translation[k];
        for (int k = 0; k < 2; k++)
            xy[k] = there[k] / there[2];
        assert_true(there[2] > 0);
        assert_near(xy[0], 0, 1e-9);
        assert_near(xy[1], 0, 1e-9);
        assert_true(f <= 45 / tan(cn_radians(20)) + 1e-9 && f >= 45 / tan(cn_radians(30)) - 1e-9);
        assert_near(path.frames[i].time_s, i * 0.1, 1e-9);
        assert_true(v->rotation[5] < 0); /* the picture is upright */
    }
    check_centre(&path, 0, 0, 0, 10);
    check_centre(&path, 10, 10, 0, 10);
    check_centre(&path, 30, 20, 5, 10);
    cn_path_deinit(&path);
}

static void straight_lines_stay_straight_and_steps_stay_small(void **state)
{
    (void)state;
    cn_frame frame = local_frame();
    cn_path path;
    const char *text = "{\"frames\":101,\"keyframes\":["
                       "{\"time_s\":0,\"local\":[0,0,0],\"heading_deg\":350},"
                       "{\"time_s\":1,\"local\":[10,0,0],\"heading_deg\":10},"
                       "{\"time_s\":2,\"local\":[20,0,0],\"heading_deg\":30}]}";
    assert_int_equal(load(&path, text, &frame), CN_OK);
    assert_int_equal(path.n_frames, 101);
    for (uint32_t i = 0; i < 101; i++) {
        check_centre(&path, i, 0.2 * i, 0, 0);
        double heading = cn_degrees(atan2(path.frames[i].view.rotation[6], path.frames[i].view.rotation[7]));
        assert_near(heading, -10 + 0.4 * i, 1e-6); /* through north, not all the way round */
    }
    cn_path_deinit(&path);
}

static void keyframes_at_one_place_do_not_blow_up(void **state)
{
    (void)state;
    cn_frame frame = local_frame();
    cn_path path;
    const char *text = "{\"frames\":31,\"keyframes\":["
                       "{\"time_s\":0,\"local\":[0,0,0],\"look_at\":{\"local\":[0,0,-9]}},"
                       "{\"time_s\":1,\"local\":[0,0,0],\"look_at\":{\"local\":[0,0,-9]}},"
                       "{\"time_s\":2,\"local\":[4,0,0],\"look_at\":{\"local\":[0,0,-9]}},"
                       "{\"time_s\":3,\"local\":[4,0,0],\"look_at\":{\"local\":[0,0,-9]}}]}";
    assert_int_equal(load(&path, text, &frame), CN_OK);
    for (uint32_t i = 0; i < 31; i++) {
        double centre[3];
        cn_view_centre(&path.frames[i].view, centre);
        assert_true(centre[0] >= -1e-9 && centre[0] <= 4 + 1e-9);
        for (int k = 0; k < 9; k++)
            assert_true(isfinite(path.frames[i].view.rotation[k]));
    }
    cn_path_deinit(&path);
}

static void geographic_places_become_local_metres(void **state)
{
    (void)state;
    cn_frame frame = local_frame();
    frame.georeferenced = true;
    frame.latitude_deg = 50;
    frame.longitude_deg = 8;
    frame.height_m = 100;
    cn_path path;
    const char *text = "{\"keyframes\":[{\"lat\":50.001,\"lon\":8,\"height_m\":150,\"look_at\":{\"local\":[0,0,0]}}]}";
    assert_int_equal(load(&path, text, &frame), CN_OK);
    double centre[3];
    cn_view_centre(&path.frames[0].view, centre);
    assert_near(centre[0], 0, 1e-3);
    assert_near(centre[1], 111.23, 0.05); /* a thousandth of a degree of latitude at 50 north */
    assert_near(centre[2], 50, 0.01);
    cn_path_deinit(&path);
}

static void bad_paths_are_refused_by_name(void **state)
{
    (void)state;
    static const struct {
        const char *text, *said;
    } cases[] = {
        { "{", "line" },
        { "{\"keyframes\":[]}", "keyframes" },
        { "{\"keyframes\":7}", "keyframes" },
        { "{\"keyframes\":[7]}", "keyframe 0" },
        { "{\"keyframes\":[{\"lat\":50,\"lon\":8,\"height_m\":1,\"heading_deg\":0}]}", "no GPS" },
        { "{\"keyframes\":[{\"local\":[0,0,0]}]}", "no direction" },
        { "{\"keyframes\":[{\"heading_deg\":0}]}", "no place" },
        { "{\"keyframes\":[{\"local\":[0,0],\"heading_deg\":0}]}", "3 numbers" },
        { "{\"keyframes\":[{\"local\":[0,0,0],\"heading_deg\":0,\"vfov_deg\":180}]}", "vfov_deg" },
        { "{\"keyframes\":[{\"local\":[0,0,0],\"heading_deg\":0,\"fov\":50}]}", "unknown key \"fov\"" },
        { "{\"keyframes\":[{\"local\":[0,0,0],\"look_at\":{\"local\":[0,0,0]}}]}", "keyframe 0" },
        { "{\"keyframes\":[{\"local\":[0,0,0],\"look_at\":{\"local\":[0,\"x\",0]}}]}", "keyframe 0, look_at" },
        { "{\"keyframes\":[{\"local\":[0,0,0],\"heading_deg\":0},{\"local\":[1,0,0],\"heading_deg\":0}]}",
          "keyframe 1" },
        { "{\"keyframes\":[{\"time_s\":1,\"local\":[0,0,0],\"heading_deg\":0},"
          "{\"time_s\":1,\"local\":[1,0,0],\"heading_deg\":0}]}",
          "times must increase" },
        { "{\"keyframes\":[{\"time_s\":0,\"local\":[0,0,0],\"heading_deg\":0},"
          "{\"time_s\":1e12,\"local\":[1,0,0],\"heading_deg\":0}]}",
          "frames" },
        { "{\"camera\":\"fisheye\",\"keyframes\":[{\"local\":[0,0,0],\"heading_deg\":0}]}",
          "\"camera\" is \"fisheye\"" },
        { "{\"fps\":0,\"keyframes\":[{\"local\":[0,0,0],\"heading_deg\":0}]}", "fps" },
        { "{\"frames\":-1,\"keyframes\":[{\"local\":[0,0,0],\"heading_deg\":0}]}", "frames" },
    };
    cn_frame frame = local_frame();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cn_path path;
        assert_int_equal(load(&path, cases[i].text, &frame), CN_ERR_FORMAT);
        assert_non_null(strstr(cn_error_message(), text_file));
        if (!strstr(cn_error_message(), cases[i].said)) fail_msg("case %zu: %s", i, cn_error_message());
        assert_null(path.frames);
    }
    cn_path path;
    cn_path_options options = cn_path_options_default();
    options.frame = &frame;
    options.width = options.height = 8;
    assert_int_equal(cn_path_load(&path, "/nonexistent/path.json", &options), CN_ERR_IO);
}

/* Pictures of all directions: half as high as wide, level, and with the camera's heading in the middle. */
static void all_directions(void **state)
{
    (void)state;
    cn_frame frame = local_frame();
    cn_path path;
    assert_int_equal(load(&path,
                          "{\"camera\":\"equirectangular\",\"keyframes\":[{\"local\":[1,2,3],\"heading_deg\":90,"
                          "\"pitch_deg\":-40,\"roll_deg\":10},{\"time_s\":1,\"local\":[5,2,3],\"heading_deg\":90,"
                          "\"pitch_deg\":-90}]}",
                          &frame),
                     CN_OK);
    for (uint32_t i = 0; i < path.n_frames; i++) {
        const cn_path_frame *f = &path.frames[i];
        assert_int_equal(f->camera.lens, CN_LENS_EQUIRECTANGULAR);
        assert_int_equal(f->camera.width, 160);
        assert_int_equal(f->camera.height, 80);
        check_vector(f->view.rotation + 3, 0, 0, -1);
    }
    check_centre(&path, 0, 1, 2, 3);
    check_centre(&path, path.n_frames - 1, 5, 2, 3);
    check_vector(path.frames[path.n_frames - 1].view.rotation + 6, 1, 0, 0); /* east, though it looks down */
    assert_near(path.frames[0].view.rotation[6], 1, 0.02);
    const cn_path_note note = { 0 };
    assert_int_equal(cn_path_save(&path, "/tmp/conurb-none.chan", &note), CN_ERR_USAGE);
    cn_path_deinit(&path);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(angles_follow_the_compass),
        cmocka_unit_test(look_at_puts_the_target_in_the_middle),
        cmocka_unit_test(straight_lines_stay_straight_and_steps_stay_small),
        cmocka_unit_test(keyframes_at_one_place_do_not_blow_up),
        cmocka_unit_test(geographic_places_become_local_metres),
        cmocka_unit_test(all_directions),
        cmocka_unit_test(bad_paths_are_refused_by_name),
    };
    return cmocka_run_group_tests(tests, text_file_make, text_file_remove);
}
