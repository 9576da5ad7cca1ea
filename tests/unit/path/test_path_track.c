#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "ground.h"

#include <string.h>

#define assert_near(value, want, tolerance) assert_true(fabs((double)(value) - (want)) <= (tolerance))

static cn_status load(cn_path *path, const char *text, const cn_path_options *options)
{
    text_file_write(text);
    return cn_path_load(path, text_file, options);
}

#define KML(INSIDE)                                                                                                    \
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<kml xmlns=\"http://www.opengis.net/kml/2.2\" "                       \
    "xmlns:gx=\"http://www.google.com/kml/ext/2.2\"><Placemark><name>a &amp; b</name>\n<gx:Track>" INSIDE              \
    "</gx:Track></Placemark></kml>\n"
#define POINTS                                                                                                         \
    "<when>2010-05-28T02:02:09Z</when><when>2010-05-28T04:02:10.5+02:00</when><when>2010-05-28T02:02:12Z</when>\n"     \
    "<gx:coord>8 50 150</gx:coord><gx:coord>8.0001 50 150</gx:coord> <gx:coord>8.0001 50.0001 150</gx:coord>"

static void times_places_and_angles(void **state)
{
    (void)state;
    cn_frame frame = synthetic_frame(true);
    cn_path_options options = synthetic_options(&frame, NULL);
    cn_path path;
    double c[3];
    assert_int_equal(load(&path,
                          KML("<altitudeMode>absolute</altitudeMode>" POINTS "<gx:angles>90 -30 0</gx:angles>"
                              "<gx:angles>0 0 0</gx:angles><gx:angles>0 0 0</gx:angles>"),
                          &options),
                     CN_OK);
    assert_int_equal(path.n_frames, 73); /* 3 s at 24 a second */
    cn_view_centre(&path.frames[0].view, c);
    assert_near(c[0], 0, 1e-6);
    assert_near(c[2], 50, 1e-3); /* the frame knows of no geoid: heights as they are */
    assert_near(path.frames[0].view.rotation[6], sqrt(0.75), 1e-6); /* to the east, 30 degrees down */
    assert_near(path.frames[0].view.rotation[8], -0.5, 1e-6);
    cn_view_centre(&path.frames[36].view, c); /* 1.5 s: the second point, whose zone was written with an offset */
    assert_near(c[0], 7.17, 0.05);
    assert_near(c[1], 0, 0.01);
    cn_view_centre(&path.frames[72].view, c);
    assert_near(c[1], 11.12, 0.05);
    cn_path_deinit(&path);
    /* Without angles the camera looks where it goes. */
    assert_int_equal(load(&path, KML("<altitudeMode>absolute</altitudeMode>" POINTS), &options), CN_OK);
    assert_near(path.frames[0].view.rotation[6], 1, 1e-3);
    assert_near(path.frames[72].view.rotation[7], 1, 1e-3);
    cn_path_deinit(&path);
}

static void heights_above_the_ground(void **state)
{
    (void)state;
    synthetic_ground ground = { .slope = 1 };
    cn_frame frame = synthetic_frame(true);
    cn_path_options options = synthetic_options(&frame, &ground);
    cn_path path;
    double c[3];
    assert_int_equal(load(&path, KML("<altitudeMode>relativeToGround</altitudeMode>" POINTS), &options), CN_OK);
    cn_view_centre(&path.frames[72].view, c);
    assert_near(c[2], c[0] + 150, 1e-6);
    cn_path_deinit(&path);
    assert_int_equal(load(&path, KML(POINTS), &options), CN_OK); /* KML's default is to clamp */
    cn_view_centre(&path.frames[0].view, c);
    assert_near(c[2], 2, 1e-6);
    cn_path_deinit(&path);
    options.height_m = 30;
    assert_int_equal(load(&path, KML("<altitudeMode>clampToGround</altitudeMode>" POINTS), &options), CN_OK);
    cn_view_centre(&path.frames[0].view, c);
    assert_near(c[2], 30, 1e-6);
    cn_path_deinit(&path);
}

static void the_sea_is_not_the_ellipsoid(void **state)
{
    (void)state;
    double undulation;
    bool found;
    assert_int_equal(cn_geo_geoid_height(50, 8, &undulation, &found), CN_OK);
    if (!found) {
        print_message("the EGM96 grid is not installed\n");
        skip();
    }
    cn_frame frame = synthetic_frame(true);
    frame.geoid_applied = true;
    cn_path_options options = synthetic_options(&frame, NULL);
    cn_path path;
    double c[3];
    assert_int_equal(load(&path, KML("<altitudeMode>absolute</altitudeMode>" POINTS), &options), CN_OK);
    cn_view_centre(&path.frames[0].view, c);
    assert_near(c[2], 50 + undulation, 1e-3);
    assert_true(undulation > 40);
    cn_path_deinit(&path);
}

static void bad_tracks_are_refused_by_line(void **state)
{
    (void)state;
    static const struct {
        const char *text, *said;
    } cases[] = {
        { "<kml>", "line 1" },
        { "<kml></kml>", "no gx:Track" },
        { KML(""), "no gx:coord" },
        { KML("\n<when>yesterday</when><gx:coord>8 50 0</gx:coord>"), "line 4" },
        { KML("<when>2010-13-28T02:02:09Z</when><gx:coord>8 50 0</gx:coord>"), "2010-13-28" },
        { KML("<when>2010-05-28T02:02:09Z</when><gx:coord>8,50,0</gx:coord>"), "8,50,0" },
        { KML("<when>2010-05-28T02:02:09Z</when><gx:coord>8 95 0</gx:coord>"), "gx:coord" },
        { KML("<when>2010-05-28T02:02:09Z</when><gx:coord>8</gx:coord>"), "gx:coord" },
        { KML("<when>2010-05-28T02:02:09Z</when><gx:coord>8 50 0</gx:coord><gx:angles>1 2</gx:angles>"), "gx:angles" },
        { KML("<gx:coord>8 50 0</gx:coord>"), "0 when" },
        { KML("<altitudeMode>relativeToSeaFloor</altitudeMode>" POINTS), "relativeToSeaFloor" },
        { KML("<altitudeMode>absolute</altitudeMode><when>2010-05-28T02:02:09Z</when><when>2010-05-28T02:02:09Z</when>"
              "<gx:coord>8 50 0</gx:coord><gx:coord>8 50 0</gx:coord>"),
          "times must increase" },
        { "<kml><Track><when>2010-05-28T02:02:09Z</when><coord>8 50 0</coord></Track><Track/></kml>", "second" },
        { "<!DOCTYPE k [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;&a;&a;\">]><kml>&b;</kml>", "no gx:Track" },
    };
    cn_frame frame = synthetic_frame(true), nowhere = synthetic_frame(false);
    cn_path_options options = synthetic_options(&frame, NULL);
    cn_path path;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        if (load(&path, cases[i].text, &options) != CN_ERR_FORMAT) fail_msg("case %zu was taken", i);
        assert_non_null(strstr(cn_error_message(), text_file));
        if (!strstr(cn_error_message(), cases[i].said)) fail_msg("case %zu: %s", i, cn_error_message());
        assert_null(path.frames);
    }
    options.frame = &nowhere;
    assert_int_equal(load(&path, KML("<altitudeMode>absolute</altitudeMode>" POINTS), &options), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "no GPS"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(times_places_and_angles),
        cmocka_unit_test(heights_above_the_ground),
        cmocka_unit_test(the_sea_is_not_the_ellipsoid),
        cmocka_unit_test(bad_tracks_are_refused_by_line),
    };
    return cmocka_run_group_tests(tests, text_file_make, text_file_remove);
}
