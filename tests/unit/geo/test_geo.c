#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/units.h"
#include "conurb/geo.h"
#include "geo/geoid.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static cn_frame frame_at(double latitude, double longitude, double height)
{
    cn_frame frame;
    cn_frame_init(&frame);
    frame.georeferenced = true;
    frame.latitude_deg = latitude;
    frame.longitude_deg = longitude;
    frame.height_m = height;
    return frame;
}

static void goes_there_and_back(double latitude, double longitude)
{
    cn_frame frame = frame_at(latitude, longitude, 120.0);
    const double offsets[][3] = { { 0, 0, 0 }, { 1000, 0, 0 }, { -3000, 5000, 40 }, { 7000, -7000, -200 } };
    for (size_t i = 0; i < sizeof offsets / sizeof *offsets; i++) {
        double place[3], back[3];
        assert_int_equal(cn_frame_to_geodetic(&frame, offsets[i], place), CN_OK);
        assert_true(fabs(place[0]) <= 90.0 && fabs(place[1]) <= 180.0);
        assert_int_equal(cn_frame_from_geodetic(&frame, place, back), CN_OK);
        for (int k = 0; k < 3; k++)
            assert_true(fabs(back[k] - offsets[i][k]) < 2e-8);
    }
}

static void test_round_trip(void **state)
{
    (void)state;
    goes_there_and_back(46.84, -91.99);
    goes_there_and_back(0.0, 0.0);
    goes_there_and_back(90.0, 0.0);
    goes_there_and_back(-90.0, 77.0);
    goes_there_and_back(-17.0, 180.0);
    goes_there_and_back(65.0, -179.9999);
}

static void test_antimeridian_is_no_seam(void **state)
{
    (void)state;
    cn_frame frame = frame_at(10.0, 179.9999, 0.0);
    const double east[3] = { 10.0, -179.9999, 0.0 };
    double local[3];
    assert_int_equal(cn_frame_from_geodetic(&frame, east, local), CN_OK);
    assert_true(local[0] > 21.0 && local[0] < 22.5 && fabs(local[1]) < 1e-3);
}

/* East of a place is a greater longitude, north a greater latitude: by the WGS84 radii of curvature. */
static void test_axes(void **state)
{
    (void)state;
    const double a = 6378137.0, e2 = 6.69437999014e-3, rad = cn_radians(1), latitude = 48.0;
    double w = 1.0 - e2 * sin(latitude * rad) * sin(latitude * rad);
    double meridian = a * (1 - e2) / pow(w, 1.5), normal = a / sqrt(w);
    cn_frame frame = frame_at(latitude, 8.0, 0.0);
    const double place[3] = { latitude + 1e-5, 8.0 + 1e-5, 3.0 };
    double local[3];
    assert_int_equal(cn_frame_from_geodetic(&frame, place, local), CN_OK);
    assert_true(fabs(local[0] - 1e-5 * rad * normal * cos(latitude * rad)) < 1e-5);
    assert_true(fabs(local[1] - 1e-5 * rad * meridian) < 1e-5);
    assert_true(fabs(local[2] - 3.0) < 1e-5);
}

static void test_not_on_earth(void **state)
{
    (void)state;
    cn_frame frame = frame_at(46.0, 8.0, 0.0), local;
    const double bad[][3] = { { 95, 8, 0 },        { NAN, 8, 0 },     { 46, NAN, 0 },
                              { 46, INFINITY, 0 }, { -90.001, 0, 0 }, { 46, 8, NAN } };
    double out[3];
    char text[32];
    int epsg;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(cn_frame_from_geodetic(&frame, bad[i], out), CN_ERR_DATA);
        if (!isnan(bad[i][2])) assert_int_equal(cn_geo_mgrs(bad[i][0], bad[i][1], 5, text), CN_ERR_DATA);
        if (!isnan(bad[i][2])) assert_int_equal(cn_geo_utm_epsg(bad[i][0], bad[i][1], &epsg), CN_ERR_DATA);
    }
    const double nowhere[3] = { 0, NAN, 0 };
    assert_int_equal(cn_frame_to_geodetic(&frame, nowhere, out), CN_ERR_DATA);
    cn_frame_init(&local);
    assert_int_equal(cn_frame_to_geodetic(&local, bad[0], out), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "georeference"));
}

static void test_mgrs_and_utm(void **state)
{
    (void)state;
    char text[32];
    int epsg;
    assert_int_equal(cn_geo_mgrs(48.8582, 2.2945, 5, text), CN_OK);
    assert_string_equal(text, "31UDQ4825111932");
    assert_int_equal(cn_geo_mgrs(48.8582, 2.2945, 0, text), CN_OK);
    assert_string_equal(text, "31UDQ");
    assert_int_equal(cn_geo_mgrs(48.8582, 2.2945, 9, text), CN_ERR_USAGE);
    assert_int_equal(cn_geo_mgrs(89.9, 0.0, 3, text), CN_OK);
    const struct {
        double latitude, longitude;
        int epsg;
    } places[] = { { 48.86, 2.29, 32631 }, { -33.9, 18.4, 32734 }, { 60.4, 5.3, 32632 },  { 89.0, 0.0, 32661 },
                   { -85.0, 0.0, 32761 },  { 10.0, 180.0, 32601 }, { 0.0, -180.0, 32601 } };
    for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
        assert_int_equal(cn_geo_utm_epsg(places[i].latitude, places[i].longitude, &epsg), CN_OK);
        assert_int_equal(epsg, places[i].epsg);
    }
}

static void test_geoid(void **state)
{
    (void)state;
    double height = 7.0, latitude = 46.842, longitude = -91.994;
    bool found = true;
    assert_int_equal(cn_geoid_heights("no-such-grid.gtx", 1, &latitude, &longitude, &height, &found), CN_OK);
    assert_false(found);
    assert_true(height == 0.0);
    assert_int_equal(cn_geo_geoid_height(latitude, longitude, &height, &found), CN_OK);
    if (!found) {
        print_message("EGM96 grid not installed: its values are not tested\n");
        return;
    }
    assert_true(fabs(height + 28.7) < 0.1);
    double turned;
    assert_int_equal(cn_geo_geoid_height(latitude, longitude + 360.0, &turned, &found), CN_OK);
    assert_true(fabs(turned - height) < 1e-6);
    assert_int_equal(cn_geo_geoid_height(90.0, 0.0, &height, &found), CN_OK);
    assert_int_equal(cn_geo_geoid_height(-12.0, 180.0, &height, &found), CN_OK);
    assert_int_equal(cn_geo_geoid_height(95.0, 0.0, &height, &found), CN_ERR_DATA);
    assert_int_equal(cn_geo_geoid_height(NAN, 0.0, &height, &found), CN_ERR_DATA);
}

static void write_text(const char *path, const char *text)
{
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    assert_true(fputs(text, file) >= 0);
    assert_int_equal(fclose(file), 0);
}

/* Of every file that is exported, F.frame.json lies beside it. */
static void test_file_beside(void **state)
{
    (void)state;
    static const char *const exports[] = { "a.ply", "b.obj", "c.glb", "d.las", "e.spz", "f.chan", "g.v2.ply" };
    char folder[] = "/tmp/conurb-geo-XXXXXX", path[64];
    const cn_frame frame = frame_at(46.8, -91.9, 169);
    cn_frame read;
    assert_non_null(mkdtemp(folder));
    for (size_t i = 0; i < sizeof exports / sizeof *exports; i++) {
        snprintf(path, sizeof path, "%s/%s", folder, exports[i]);
        assert_int_equal(cn_frame_save_beside(&frame, path), CN_OK);
        strcpy(strrchr(path, '.'), ".frame.json");
        assert_int_equal(cn_frame_load(&read, path), CN_OK);
        assert_int_equal(unlink(path), 0);
    }
    assert_int_equal(rmdir(folder), 0);
}

static void test_file(void **state)
{
    (void)state;
    char folder[] = "/tmp/conurb-geo-XXXXXX", path[64];
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/frame.json", folder);
    cn_frame frame = frame_at(46.84260718, -91.9944, 169.123456789012345), read;
    frame.geoid_applied = frame.nadir_ambiguous = true;
    frame.geoid_height_m = -28.71;
    frame.scale = 3.25;
    for (int i = 0; i < 9; i++)
        frame.rotation[i] = sin(i + 0.1);
    for (int i = 0; i < 3; i++)
        frame.translation[i] = 1.0 / (i + 3);
    frame.residual_horizontal_m = 0.5;
    frame.residual_vertical_m = 0.25;
    frame.n_gps = 18;
    frame.n_inliers = 17;
    assert_int_equal(cn_frame_save(&frame, path), CN_OK);
    assert_int_equal(cn_frame_load(&read, path), CN_OK);
    assert_true(read.georeferenced && read.geoid_applied && read.nadir_ambiguous);
    assert_true(read.latitude_deg == frame.latitude_deg && read.longitude_deg == frame.longitude_deg);
    assert_true(read.height_m == frame.height_m && read.geoid_height_m == frame.geoid_height_m);
    assert_true(read.scale == frame.scale && read.n_gps == 18 && read.n_inliers == 17);
    assert_memory_equal(read.rotation, frame.rotation, sizeof frame.rotation);
    assert_memory_equal(read.translation, frame.translation, sizeof frame.translation);
    assert_true(read.residual_horizontal_m == 0.5 && read.residual_vertical_m == 0.25);
    write_text(path, "{\"version\": 99}");
    assert_int_equal(cn_frame_load(&read, path), CN_ERR_VERSION);
    write_text(path, "{\"version\": 1, \"georeferenced\": 3}");
    assert_int_equal(cn_frame_load(&read, path), CN_ERR_FORMAT);
    write_text(path, "[]");
    assert_int_equal(cn_frame_load(&read, path), CN_ERR_FORMAT);
    write_text(path, "{\"version\": 1,");
    assert_int_equal(cn_frame_load(&read, path), CN_ERR_FORMAT);
    unlink(path);
    assert_int_equal(cn_frame_load(&read, path), CN_ERR_IO);
    rmdir(folder);
    assert_int_not_equal(cn_frame_save(&frame, path), CN_OK);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round_trip),   cmocka_unit_test(test_antimeridian_is_no_seam),
        cmocka_unit_test(test_axes),         cmocka_unit_test(test_not_on_earth),
        cmocka_unit_test(test_mgrs_and_utm), cmocka_unit_test(test_geoid),
        cmocka_unit_test(test_file_beside),  cmocka_unit_test(test_file),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
