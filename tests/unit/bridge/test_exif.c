/* EXIF as cameras write it, and as they should not. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "segment.h"

#include "base/file.h"
#include "bridge/exiv2.h"
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

static void write_grey(const cn_oiio_attribute *attributes)
{
    static const float grey[8 * 8 * 3];
    assert_int_equal(cn_oiio_write_jpeg(path, grey, 8, 8, attributes), CN_OK);
}

/* By both libraries: OpenImageIO is asked for the kinds of file that exiv2 does not know. */
static cn_exif round_trip(const cn_oiio_attribute *attributes)
{
    cn_oiio_info info;
    cn_exif exif;
    write_grey(attributes);
    assert_int_equal(cn_oiio_read_info(path, &info), CN_OK);
    assert_int_equal(cn_exiv2_read(path, &exif), CN_OK);
    assert_int_equal(exif.has_latlon, info.exif.has_latlon);
    assert_int_equal(exif.has_bad_gps, info.exif.has_bad_gps);
    assert_true(fabs(exif.latitude_deg - info.exif.latitude_deg) < 1e-6);
    assert_true(fabs(exif.longitude_deg - info.exif.longitude_deg) < 1e-5);
    assert_int_equal(exif.has_altitude, info.exif.has_altitude);
    assert_true(fabs(exif.altitude_m - info.exif.altitude_m) < 1e-6);
    assert_string_equal(exif.datetime, info.exif.datetime);
    assert_string_equal(exif.subsec, info.exif.subsec);
    assert_string_equal(exif.model, info.exif.model);
    return exif;
}

/* Makes a rational of the file 0/0, as cameras write what they do not know. */
static cn_exif zero_rational(uint32_t numerator, uint32_t denominator)
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
    cn_exif exif;
    assert_int_equal(cn_exiv2_read(path, &exif), CN_OK);
    return exif;
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
        const cn_exif exif = round_trip(attributes);
        assert_true(exif.has_latlon);
        assert_false(exif.has_bad_gps);
        assert_false(exif.has_altitude);
        assert_true(fabs(exif.latitude_deg - (i & 1 ? -1 : 1) * (46 + 50 / 60.0 + 33.3855 / 3600)) < 1e-8);
        assert_true(fabs(exif.longitude_deg - (i >> 1 ? -1 : 1) * (91 + 59 / 60.0 + 40.4156 / 3600)) < 1e-8);
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
        const cn_exif exif = round_trip(cases[i]);
        assert_true(exif.has_altitude);
        assert_true(fabs(exif.altitude_m - want[i]) < 1e-6);
        assert_false(exif.has_latlon);
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
        const cn_exif exif = round_trip(attributes);
        assert_false(exif.has_latlon);
        assert_true(exif.has_bad_gps);
    }
    const cn_oiio_attribute alone[] = { { "GPS:Latitude", NULL, LAT, 3 }, END };
    assert_true(round_trip(alone).has_bad_gps);
}

/* Cameras without a fix write 0, 0. Both zeros are needed: the equator and Greenwich have cities. */
static void zero_zero_is_no_gps(void **state)
{
    (void)state;
    static const double zero[3] = { 0, 0, 0 };
    for (int i = 0; i < 3; i++) {
        const cn_oiio_attribute attributes[] = { { "GPS:Latitude", NULL, i == 1 ? LAT : zero, 3 },
                                                 { "GPS:LatitudeRef", "N", NULL, 0 },
                                                 { "GPS:Longitude", NULL, i == 2 ? LON : zero, 3 },
                                                 { "GPS:LongitudeRef", "E", NULL, 0 },
                                                 END };
        const cn_exif exif = round_trip(attributes);
        assert_int_equal(exif.has_latlon, i > 0);
        assert_int_equal(exif.has_bad_gps, i == 0);
    }
}

static void unknown_parts_of_a_position(void **state)
{
    (void)state;
    const double altitude = 7.5;
    const cn_oiio_attribute attributes[] = {
        { "GPS:Latitude", NULL, LAT, 3 }, { "GPS:Longitude", NULL, LON, 3 }, { "GPS:Altitude", NULL, &altitude, 1 }, END
    };
    round_trip(attributes);
    cn_exif exif = zero_rational(75, 10);
    assert_true(exif.has_latlon);
    assert_false(exif.has_altitude);
    exif = zero_rational(59, 1); /* minutes not known: taken as none */
    assert_true(exif.has_latlon);
    assert_true(fabs(exif.longitude_deg - (91 + 40.4156 / 3600)) < 1e-8);
    exif = zero_rational(46, 1); /* degrees not known: no place */
    assert_false(exif.has_latlon);
    assert_true(exif.has_bad_gps);
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
    const cn_exif exif = round_trip(attributes);
    assert_true(fabs(exif.exposure_s - shutter) < 1e-7);
    assert_true(fabs(exif.f_number - f) < 1e-6);
    assert_float_equal(exif.iso, iso, 0);
    assert_true(fabs(exif.focal_mm - focal) < 1e-6);
    assert_float_equal(exif.focal_35mm, focal35, 0);
    assert_string_equal(exif.datetime, "2016:06:23 16:31:59");
    assert_string_equal(exif.subsec, "25");
    assert_string_equal(exif.make, "DJI");
    assert_string_equal(exif.model, "FC300S");
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

static void expect_nothing_known(const cn_exif *exif)
{
    assert_true(isnan(exif->exposure_s) && isnan(exif->f_number) && isnan(exif->iso));
    assert_true(isnan(exif->focal_mm) && isnan(exif->focal_35mm));
    assert_false(exif->has_latlon || exif->has_altitude || exif->has_bad_gps);
    assert_string_equal(exif->datetime, "");
}

static void what_is_absent_or_zero_is_nan(void **state)
{
    (void)state;
    const double none = 0, shutter = 1 / 250.0;
    const cn_oiio_attribute attributes[] = { { "ExposureTime", NULL, &shutter, 1 },
                                             { "FNumber", NULL, &none, 1 },
                                             END };
    cn_exif exif = round_trip(NULL);
    expect_nothing_known(&exif);
    exif = round_trip(attributes);
    assert_true(exif.exposure_s > 0 && isnan(exif.f_number));
    exif = zero_rational(4, 1000);
    expect_nothing_known(&exif);
}

/* Many writers give degrees as one rational and leave the rest 0. A float there is 0.2 to 0.85 m off. */
static void degrees_as_one_rational_are_exact(void **state)
{
    (void)state;
    const segment_tag tags[] = {
        { SEGMENT_GPS, 1, .text = "N" },
        { SEGMENT_GPS, 2, .n_rationals = 3, .rationals = { { 468426093, 10000000 }, { 0, 1 }, { 0, 1 } } },
        { SEGMENT_GPS, 3, .text = "W" },
        { SEGMENT_GPS, 4, .n_rationals = 3, .rationals = { { 3919944893, 21777777 }, { 0, 0 }, { 0, 0 } } },
        { SEGMENT_GPS, 6, .n_rationals = 1, .rationals = { { 16777217, 1000 } } },
    };
    cn_exif exif;
    write_grey(NULL);
    segment_exif(path, tags, sizeof tags / sizeof *tags);
    assert_int_equal(cn_exiv2_read(path, &exif), CN_OK);
    assert_true(exif.has_latlon && !exif.has_bad_gps && exif.has_altitude);
    assert_true(fabs(exif.latitude_deg - 46.8426093) < 1e-12);
    assert_true(fabs(exif.longitude_deg + 3919944893 / 21777777.0) < 1e-12); /* past 31 bits */
    assert_true(exif.altitude_m == 16777.217);
}

static void nothing_over_nothing_is_not_known(void **state)
{
    (void)state;
    const segment_tag tags[] = {
        { SEGMENT_PHOTO, 0x829a, .n_rationals = 1 },
        { SEGMENT_PHOTO, 0x829d, .n_rationals = 1, .rationals = { { 28, 10 } } },
        { SEGMENT_PHOTO, 0x920a, .n_rationals = 1, .rationals = { { 5, 0 } } },
        { SEGMENT_GPS, 2, .n_rationals = 3 },
        { SEGMENT_GPS, 4, .n_rationals = 3 },
        { SEGMENT_GPS, 6, .n_rationals = 1 },
    };
    cn_exif exif;
    write_grey(NULL);
    segment_exif(path, tags, sizeof tags / sizeof *tags);
    assert_int_equal(cn_exiv2_read(path, &exif), CN_OK);
    assert_true(isnan(exif.exposure_s) && exif.f_number == 2.8 && isnan(exif.focal_mm));
    assert_true(exif.has_bad_gps && !exif.has_latlon && !exif.has_altitude);
}

static void the_offset_from_utc_is_read(void **state)
{
    (void)state;
    const segment_tag tags[] = { { SEGMENT_IMAGE, 0x010f, .text = "Acme" },
                                 { SEGMENT_PHOTO, 0x9003, .text = "2016:06:23 16:31:59" },
                                 { SEGMENT_PHOTO, 0x9011, .text = "+02:00" } };
    cn_exif exif;
    write_grey(NULL);
    segment_exif(path, tags, sizeof tags / sizeof *tags);
    assert_int_equal(cn_exiv2_read(path, &exif), CN_OK);
    assert_string_equal(exif.make, "Acme");
    assert_string_equal(exif.datetime, "2016:06:23 16:31:59");
    assert_string_equal(exif.offset, "+02:00");
}

static void what_is_no_photo_has_no_exif(void **state)
{
    (void)state;
    cn_exif exif;
    assert_int_equal(cn_file_write(path, "no photo", 8), CN_OK);
    assert_int_equal(cn_exiv2_read(path, &exif), CN_ERR_FORMAT);
    expect_nothing_known(&exif);
    assert_int_equal(cn_exiv2_read("/no/such/photo.jpg", &exif), CN_ERR_FORMAT);
    expect_nothing_known(&exif);
}

#define PACKET(body)                                                                                                   \
    "<?xpacket begin='' id='W5M0MpCehiHzreSzNTczkc9d'?><x:xmpmeta xmlns:x='adobe:ns:meta/'><rdf:RDF "                  \
    "xmlns:rdf='http://www.w3.org/1999/02/22-rdf-syntax-ns#'>" body "</rdf:RDF></x:xmpmeta><?xpacket end='w'?>"

/* As DJI's RTK drones write it, as Pix4D's namespace has it, and EXIF's own tag. */
static void accuracy_is_read(void **state)
{
    (void)state;
    static const char *const packets[] = {
        PACKET("<rdf:Description rdf:about='DJI Meta Data' xmlns:drone-dji='http://www.dji.com/drone-dji/1.0/' "
               "drone-dji:RtkFlag='50' drone-dji:RtkStdLon='0.01273' drone-dji:RtkStdLat='0.01391' "
               "drone-dji:RtkStdHgt='0.03102'/>"),
        PACKET("<rdf:Description rdf:about='' xmlns:Camera='http://pix4d.com/camera/1.0/'><Camera:GPSXYAccuracy>0.5"
               "</Camera:GPSXYAccuracy><Camera:GPSZAccuracy>0.8</Camera:GPSZAccuracy></rdf:Description>"),
        PACKET("<rdf:Description rdf:about='' xmlns:drone-dji='http://www.dji.com/drone-dji/1.0/' "
               "drone-dji:RtkStdLon='none'/>")
    };
    static const double wanted[3][3] = { { 0.01273, 0.01391, 0.03102 }, { 0.5, 0.5, 0.8 }, { 0, 0, 0 } };
    static const segment_tag focal = { SEGMENT_PHOTO, 0x920a, NULL, 1, { { 8, 1 } } };
    static const segment_tag error = { SEGMENT_GPS, 0x001f, NULL, 1, { { 47, 10 } } };
    cn_exif exif;
    const cn_oiio_attribute none[] = { END };
    for (int i = 0; i < 3; i++) {
        write_grey(none);
        segment_xmp(path, packets[i]);
        segment_exif(path, &focal, 1);
        assert_int_equal(cn_exiv2_read(path, &exif), CN_OK);
        for (int k = 0; k < 3; k++)
            assert_true(exif.gps_sigma_m[k] == wanted[i][k]);
    }
    write_grey(none);
    segment_exif(path, &error, 1);
    assert_int_equal(cn_exiv2_read(path, &exif), CN_OK);
    assert_true(exif.gps_sigma_m[0] == 4.7 && exif.gps_sigma_m[1] == 4.7 && exif.gps_sigma_m[2] == 9.4);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hemispheres_give_signs),
        cmocka_unit_test(the_altitude_reference_is_applied),
        cmocka_unit_test(no_place_on_earth_is_no_gps),
        cmocka_unit_test(zero_zero_is_no_gps),
        cmocka_unit_test(unknown_parts_of_a_position),
        cmocka_unit_test(exposure_and_lens_are_read),
        cmocka_unit_test(what_is_absent_or_zero_is_nan),
        cmocka_unit_test(whole_fractions_of_a_second_are_written),
        cmocka_unit_test(accuracy_is_read),
        cmocka_unit_test(degrees_as_one_rational_are_exact),
        cmocka_unit_test(nothing_over_nothing_is_not_known),
        cmocka_unit_test(the_offset_from_utc_is_read),
        cmocka_unit_test(what_is_no_photo_has_no_exif),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
