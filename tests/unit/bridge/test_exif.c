/* EXIF as cameras write it, and as they should not. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "bridge/oiio.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char path[] = "/tmp/conurb-exif-XXXXXX.jpg";

static int set_up(void **state)
{
    (void)state;
    const int fd = mkstemps(path, 4);
    return fd < 0 ? -1 : close(fd);
}
static int tear_down(void **state)
{
    (void)state;
    return unlink(path);
}

static cn_oiio_info round_trip(const cn_oiio_attribute *attributes)
{
    static const float grey[8 * 8 * 3];
    cn_oiio_info info;
    assert_int_equal(cn_oiio_write_jpeg(path, grey, 8, 8, attributes), CN_OK);
    assert_int_equal(cn_oiio_read_info(path, &info), CN_OK);
    return info;
}

/* Makes a rational of the file 0/0, as cameras write what they do not know. */
static cn_oiio_info zero_rational(uint32_t numerator, uint32_t denominator)
{
    const uint32_t rational[2] = { numerator, denominator };
    char *data;
    size_t size;
    int found = 0;
    assert_int_equal(cn_file_read(path, 0, &data, &size), CN_OK);
    for (size_t i = 0; i + sizeof rational <= size; i++)
        if (memcmp(data + i, rational, sizeof rational) == 0) {
            memset(data + i, 0, sizeof rational);
            found++;
        }
    assert_int_equal(found, 1);
    assert_int_equal(cn_file_write(path, data, size), CN_OK);
    free(data);
    cn_oiio_info info;
    assert_int_equal(cn_oiio_read_info(path, &info), CN_OK);
    return info;
}

static const double LAT[3] = { 46, 50, 33.3855 }, LON[3] = { 91, 59, 40.4156 };
static const double HEIGHT = 12.5, ABOVE = 0, BELOW = 1;
#define END                                                                                                            \
    {                                                                                                                  \
        NULL, NULL, NULL, 0                                                                                            \
    }

static void hemispheres_give_signs(void **state)
{
    (void)state;
    static const char *const ns[] = { "N", "S" }, *const ew[] = { "E", "W" };
    for (int i = 0; i < 4; i++) {
        const cn_oiio_attribute attributes[] = { { "GPS:Latitude", NULL, LAT, 3 },
                                                 { "GPS:LatitudeRef", ns[i & 1], NULL, 0 },
                                                 { "GPS:Longitude", NULL, LON, 3 },
                                                 { "GPS:LongitudeRef", ew[i >> 1], NULL, 0 },
                                                 END };
        const cn_oiio_info info = round_trip(attributes);
        assert_true(info.has_latlon);
        assert_false(info.has_bad_gps);
        assert_false(info.has_altitude);
        assert_true(fabs(info.latitude_deg - (i & 1 ? -1 : 1) * (46 + 50 / 60.0 + 33.3855 / 3600)) < 1e-8);
        assert_true(fabs(info.longitude_deg - (i >> 1 ? -1 : 1) * (91 + 59 / 60.0 + 40.4156 / 3600)) < 1e-8);
    }
}

static void the_altitude_reference_is_applied(void **state)
{
    (void)state;
    const cn_oiio_attribute above[] = { { "GPS:Altitude", NULL, &HEIGHT, 1 },
                                        { "GPS:AltitudeRef", NULL, &ABOVE, 1 },
                                        END };
    const cn_oiio_attribute below[] = { { "GPS:Altitude", NULL, &HEIGHT, 1 },
                                        { "GPS:AltitudeRef", NULL, &BELOW, 1 },
                                        END };
    const cn_oiio_attribute absent[] = { { "GPS:Altitude", NULL, &HEIGHT, 1 }, END };
    const cn_oiio_attribute *const cases[] = { above, below, absent };
    static const double want[] = { 12.5, -12.5, 12.5 };
    for (int i = 0; i < 3; i++) {
        const cn_oiio_info info = round_trip(cases[i]);
        assert_true(info.has_altitude);
        assert_true(fabs(info.altitude_m - want[i]) < 1e-6);
        assert_false(info.has_latlon);
    }
}

static void no_place_on_earth_is_no_gps(void **state)
{
    (void)state;
    static const double nowhere[][3] = { { 95, 0, 0 }, { 89, 90, 0 } };
    for (size_t i = 0; i < sizeof nowhere / sizeof *nowhere; i++) {
        const cn_oiio_attribute attributes[] = { { "GPS:Latitude", NULL, nowhere[i], 3 },
                                                 { "GPS:LatitudeRef", "N", NULL, 0 },
                                                 { "GPS:Longitude", NULL, LON, 3 },
                                                 { "GPS:LongitudeRef", "E", NULL, 0 },
                                                 END };
        const cn_oiio_info info = round_trip(attributes);
        assert_false(info.has_latlon);
        assert_true(info.has_bad_gps);
    }
    const cn_oiio_attribute alone[] = { { "GPS:Latitude", NULL, LAT, 3 }, END };
    assert_true(round_trip(alone).has_bad_gps);
}

static void unknown_parts_of_a_position(void **state)
{
    (void)state;
    const double altitude = 7.5;
    const cn_oiio_attribute attributes[] = {
        { "GPS:Latitude", NULL, LAT, 3 }, { "GPS:Longitude", NULL, LON, 3 }, { "GPS:Altitude", NULL, &altitude, 1 }, END
    };
    round_trip(attributes);
    cn_oiio_info info = zero_rational(75, 10);
    assert_true(info.has_latlon);
    assert_false(info.has_altitude);
    info = zero_rational(59, 1); /* minutes not known: taken as none */
    assert_true(info.has_latlon);
    assert_true(fabs(info.longitude_deg - (91 + 40.4156 / 3600)) < 1e-8);
    info = zero_rational(46, 1); /* degrees not known: no place */
    assert_false(info.has_latlon);
    assert_true(info.has_bad_gps);
}

static void exposure_and_lens_are_read(void **state)
{
    (void)state;
    const double shutter = 1 / 250.0, f = 2.8, iso = 400, focal = 3.6, focal35 = 20;
    const cn_oiio_attribute attributes[] = { { "ExposureTime", NULL, &shutter, 1 },
                                             { "FNumber", NULL, &f, 1 },
                                             { "Exif:PhotographicSensitivity", NULL, &iso, 1 },
                                             { "Exif:FocalLength", NULL, &focal, 1 },
                                             { "Exif:FocalLengthIn35mmFilm", NULL, &focal35, 1 },
                                             { "Exif:DateTimeOriginal", "2016:06:23 16:31:59", NULL, 0 },
                                             { "Exif:SubsecTimeOriginal", "25", NULL, 0 },
                                             { "Make", "DJI", NULL, 0 },
                                             { "Model", "FC300S", NULL, 0 },
                                             END };
    const cn_oiio_info info = round_trip(attributes);
    assert_true(fabs(info.exposure_s - shutter) < 1e-7);
    assert_true(fabs(info.f_number - f) < 1e-6);
    assert_float_equal(info.iso, iso, 0);
    assert_true(fabs(info.focal_mm - focal) < 1e-6);
    assert_float_equal(info.focal_35mm, focal35, 0);
    assert_string_equal(info.datetime, "2016:06:23 16:31:59");
    assert_string_equal(info.subsec, "25");
    assert_string_equal(info.make, "DJI");
    assert_string_equal(info.model, "FC300S");
}

static void whole_fractions_of_a_second_are_written(void **state)
{
    (void)state;
    for (int i = 0; i < 13; i++) {
        const double shutter = ldexp(1, -i);
        const cn_oiio_attribute attributes[] = { { "ExposureTime", NULL, &shutter, 1 }, END };
        assert_true(fabs(round_trip(attributes).exposure_s / shutter - 1) < 1e-3);
    }
}

static void expect_nothing_known(const cn_oiio_info *info)
{
    assert_true(isnan(info->exposure_s) && isnan(info->f_number) && isnan(info->iso));
    assert_true(isnan(info->focal_mm) && isnan(info->focal_35mm));
    assert_false(info->has_latlon || info->has_altitude || info->has_bad_gps);
    assert_string_equal(info->datetime, "");
    assert_int_equal(info->orientation, 1);
}

static void what_is_absent_or_zero_is_nan(void **state)
{
    (void)state;
    const double none = 0, shutter = 1 / 250.0;
    const cn_oiio_attribute attributes[] = { { "ExposureTime", NULL, &shutter, 1 },
                                             { "FNumber", NULL, &none, 1 },
                                             END };
    cn_oiio_info info = round_trip(NULL);
    expect_nothing_known(&info);
    info = round_trip(attributes);
    assert_true(info.exposure_s > 0 && isnan(info.f_number));
    info = zero_rational(4, 1000);
    expect_nothing_known(&info);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hemispheres_give_signs),
        cmocka_unit_test(the_altitude_reference_is_applied),
        cmocka_unit_test(no_place_on_earth_is_no_gps),
        cmocka_unit_test(unknown_parts_of_a_position),
        cmocka_unit_test(exposure_and_lens_are_read),
        cmocka_unit_test(what_is_absent_or_zero_is_nan),
        cmocka_unit_test(whole_fractions_of_a_second_are_written),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
