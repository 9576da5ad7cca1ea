#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "ground.h"
#include "path/path.h"

#include <string.h>

#define assert_near(value, want, tolerance) assert_true(fabs((double)(value) - (want)) <= (tolerance))

static cn_status load(cn_path *path, const char *text, const cn_path_options *options)
{
    text_file_write(text);
    return cn_path_load(path, text_file, options);
}

static void centre_of(const cn_path *path, uint32_t i, double centre[3])
{
    cn_view_centre(&path->frames[i].view, centre);
}

#define STREET(PROPERTIES, COORDINATES)                                                                                \
    "{\"type\":\"FeatureCollection\",\"features\":[{\"type\":\"Feature\",\"properties\":{" PROPERTIES "},"             \
    "\"geometry\":{\"type\":\"LineString\",\"coordinates\":" COORDINATES "}}]}"

static void a_straight_street_follows_the_slope(void **state)
{
    (void)state;
    synthetic_ground ground = { .slope = 0.1, .post_x = 50, .post_height = 6 };
    cn_frame frame = synthetic_frame(false);
    cn_path_options options = synthetic_options(&frame, &ground);
    cn_path path;
    assert_int_equal(load(&path,
                          STREET("\"local\":true,\"height_m\":3,\"speed_mps\":10,\"fps\":10,\"name\":\"High Street\"",
                                 "[[0,0],[100,0]]"),
                          &options),
                     CN_OK);
    assert_int_equal(path.n_frames, 101);
    assert_near(path.fps, 10, 0);
    for (uint32_t i = 0; i < path.n_frames; i++) {
        double c[3];
        centre_of(&path, i, c);
        assert_near(c[0], i, 1e-6);
        assert_near(c[1], 0, 1e-9);
        assert_true(c[2] >= 0.1 * c[0] + 3 - 1e-9); /* never nearer to the ground than asked for */
        assert_true(c[2] <= 0.1 * c[0] + 3 + 1.2);  /* and the lamp post does not lift the camera */
        const double *r = path.frames[i].view.rotation;
        assert_near(r[6], 1, 1e-9); /* looks along the street, level */
        assert_near(r[8], 0, 1e-9);
    }
    cn_path_deinit(&path);
    options.height_m = 20; /* --height wins */
    options.n_frames = 7;
    double c[3];
    assert_int_equal(load(&path, STREET("\"local\":true,\"height_m\":3", "[[0,0],[100,0]]"), &options), CN_OK);
    assert_int_equal(path.n_frames, 7);
    centre_of(&path, 0, c);
    assert_near(c[2], 20 + 1, 1.2);
    cn_path_deinit(&path);
}

static void corners_are_rounded(void **state)
{
    (void)state;
    synthetic_ground ground = { 0 };
    cn_frame frame = synthetic_frame(false);
    cn_path_options options = synthetic_options(&frame, &ground);
    options.n_frames = 201;
    cn_path path;
    assert_int_equal(load(&path, STREET("\"local\":true,\"height_m\":2", "[[0,0],[60,0],[60,0],[60,60]]"), &options),
                     CN_OK);
    double first[3], last[3], before[3], largest = 0, step = 0;
    centre_of(&path, 0, first);
    centre_of(&path, 200, last);
    assert_near(hypot(first[0], first[1]), 0, 1e-6);
    assert_near(hypot(last[0] - 60, last[1] - 60), 0, 1e-6);
    for (uint32_t i = 1; i < path.n_frames; i++) {
        double c[3], dot = 0;
        for (int k = 6; k < 9; k++)
            dot += path.frames[i].view.rotation[k] * path.frames[i - 1].view.rotation[k];
        largest = fmax(largest, acos(fmin(dot, 1)));
        centre_of(&path, i, c);
        centre_of(&path, i - 1, before);
        step = fmax(step, hypot(c[0] - before[0], c[1] - before[1]));
        assert_true(c[0] < 60 + 1e-6 && c[1] > -1e-6 && fmin(60 - c[0], c[1]) < 2);
    }
    assert_true(largest < 0.2); /* no quarter turn at once */
    assert_true(step < 0.61);   /* an even speed: 120 m in 200 steps, less what the corner saves */
    cn_path_deinit(&path);
}

static void places_on_earth_and_gaps(void **state)
{
    (void)state;
    synthetic_ground ground = { .slope = 0 };
    cn_frame frame = synthetic_frame(true);
    cn_path_options options = synthetic_options(&frame, &ground);
    options.n_frames = 11;
    cn_path path;
    double c[3];
    assert_int_equal(load(&path, "{\"type\":\"LineString\",\"coordinates\":[[8,50],[8,50.001]]}", &options), CN_OK);
    centre_of(&path, 10, c);
    assert_near(c[1], 111.23, 0.05);
    assert_near(c[2], 2, 1e-6);
    cn_path_deinit(&path);
    /* Longitude 7.98 lies 1.4 km to the west, where nothing is: the height holds on from where there was ground. */
    assert_int_equal(load(&path, "{\"type\":\"LineString\",\"coordinates\":[[8,50],[7.98,50]]}", &options), CN_OK);
    centre_of(&path, 10, c);
    assert_true(c[0] < -1000);
    assert_near(c[2], 2, 1e-6);
    cn_path_deinit(&path);
    assert_int_equal(load(&path, "{\"type\":\"LineString\",\"coordinates\":[[7.97,50],[7.98,50]]}", &options),
                     CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "no ground"));
    options.sound = NULL;
    assert_int_equal(load(&path, "{\"type\":\"LineString\",\"coordinates\":[[8,50],[8,50.001]]}", &options),
                     CN_ERR_USAGE);
}

static void bad_streets_are_refused_by_name(void **state)
{
    (void)state;
    static const struct {
        const char *text, *said;
    } cases[] = {
        { "{\"type\":\"FeatureCollection\",\"features\":[]}", "has 0" },
        { "{\"type\":\"Point\",\"coordinates\":[8,50]}", "has 0" },
        { "{\"type\":7}", "has 0" },
        { "{\"type\":\"GeometryCollection\",\"geometries\":[{\"type\":\"LineString\"},{\"type\":\"LineString\"}]}",
          "has 2" },
        { "{\"type\":\"LineString\"}", "\"coordinates\"" },
        { "{\"type\":\"LineString\",\"coordinates\":[[8,50]]}", "1 vertices" },
        { "{\"type\":\"LineString\",\"coordinates\":[[8,50],[8]]}", "vertex 1" },
        { "{\"type\":\"LineString\",\"coordinates\":[[8,50],[8,\"50\"]]}", "vertex 1" },
        { "{\"type\":\"LineString\",\"coordinates\":[[8,50],[8,95]]}", "longitude comes first" },
        { "{\"type\":\"LineString\",\"coordinates\":[[50,8],[50,8.1]]}", "km from the city" },
        { "{\"type\":\"LineString\",\"coordinates\":[[8,50],[8,50]]}", "no length" },
        { STREET("\"speed_mps\":0", "[[8,50],[8,50.1]]"), "speed_mps" },
        { STREET("\"height_m\":\"low\"", "[[8,50],[8,50.1]]"), "height_m" },
        { STREET("\"vfov_deg\":0", "[[8,50],[8,50.1]]"), "vfov_deg" },
        { STREET("\"pitch_deg\":100", "[[8,50],[8,50.1]]"), "pitch_deg" },
        { STREET("\"fps\":-1", "[[8,50],[8,50.1]]"), "fps" },
        { STREET("\"speed_mps\":1e-6", "[[8,50],[8,50.1]]"), "frames" },
    };
    synthetic_ground ground = { 0 };
    cn_frame frame = synthetic_frame(true), nowhere = synthetic_frame(false);
    cn_path_options options = synthetic_options(&frame, &ground);
    cn_path path;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        if (load(&path, cases[i].text, &options) != CN_ERR_FORMAT) fail_msg("case %zu was taken", i);
        assert_non_null(strstr(cn_error_message(), text_file));
        if (!strstr(cn_error_message(), cases[i].said)) fail_msg("case %zu: %s", i, cn_error_message());
        assert_null(path.frames);
    }
    options.frame = &nowhere;
    assert_int_equal(load(&path, "{\"type\":\"LineString\",\"coordinates\":[[8,50],[8,50.1]]}", &options),
                     CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "no GPS"));
}

static void smooth_heights_stay_clear(void **state)
{
    (void)state;
    double z[400], before[400];
    for (size_t i = 0; i < 400; i++)
        z[i] = before[i] = 3 * sin((double)i / 15) + (i > 200 ? 5 : 0);
    assert_int_equal(cn_path_smooth_above(400, z, 8), CN_OK);
    for (size_t i = 0; i < 400; i++) {
        if (i > 8 && i < 391) assert_true(z[i] > before[i] - 1.0); /* the median trims a sharp crest */
        if (i) assert_true(fabs(z[i] - z[i - 1]) < 1.1);
    }
    double one = 4;
    assert_int_equal(cn_path_smooth_above(1, &one, 3), CN_OK);
    assert_near(one, 4, 1e-12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_straight_street_follows_the_slope),
        cmocka_unit_test(corners_are_rounded),
        cmocka_unit_test(places_on_earth_and_gaps),
        cmocka_unit_test(bad_streets_are_refused_by_name),
        cmocka_unit_test(smooth_heights_stay_clear),
    };
    return cmocka_run_group_tests(tests, text_file_make, text_file_remove);
}
