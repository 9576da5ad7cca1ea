/* Tracks of GPS in each of their forms. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "video/gps_track.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define assert_near(value, want, tolerance) assert_true(fabs((double)(value) - (want)) <= (tolerance))

static cn_gps_track track;

static cn_status read_text(const char *text)
{
    text_file_write(text);
    return cn_gps_track_read(&track, text_file);
}

static void refuse(const char *text, const char *reason)
{
    assert_int_equal(read_text(text), CN_ERR_FORMAT);
    assert_null(track.points);
    if (!strstr(cn_error_message(), reason)) fail_msg("\"%s\" lacks \"%s\"", cn_error_message(), reason);
    assert_non_null(strstr(cn_error_message(), text_file));
}

#define GPX(INSIDE) "\xef\xbb\xbf<?xml version=\"1.0\"?><gpx><trk><trkseg>" INSIDE "</trkseg></trk></gpx>"
#define POINT(LAT, LON, ELE, TIME) "<trkpt lat=\"" LAT "\" lon=\"" LON "\">" ELE "<time>" TIME "</time></trkpt>\n"

static void test_gpx(void **state)
{
    (void)state;
    cn_gps_point at;
    /* Out of order, one time twice, one point without a fix */
    assert_int_equal(
        read_text(GPX(POINT("47.2", "8.4", "<ele>420</ele>", "2024-05-01T12:00:04+02:00")
                          POINT("47.1", "8.2", "<ele>400</ele>", "2024-05-01T10:00:00Z")
                              POINT("0", "0", "", "2024-05-01T10:00:02Z") POINT("50", "9", "", "2024-05-01T10:00:04Z")
                                  POINT("47.2", "8.4", "", "2024-05-01T10:00:30Z"))),
        CN_OK);
    assert_false(track.from_start);
    assert_int_equal(track.n, 3);
    const double begin_s = 1714557600; /* 2024-05-01T10:00:00Z */
    assert_near(track.points[0].time_s, begin_s, 0);
    assert_true(cn_gps_track_at(&track, begin_s + 1, &at));
    assert_near(at.latitude_deg, 47.125, 1e-9);
    assert_near(at.longitude_deg, 8.25, 1e-9);
    assert_near(at.altitude_m, 405, 1e-9);
    assert_true(cn_gps_track_at(&track, begin_s - 0.9, &at));
    assert_near(at.latitude_deg, 47.1, 0);
    assert_false(cn_gps_track_at(&track, begin_s - 1.1, &at));
    assert_false(cn_gps_track_at(&track, begin_s + 10, &at));                    /* a gap of 26 s */
    assert_true(cn_gps_track_at(&track, track.points[track.n - 2].time_s, &at)); /* at its first end there is a place */
    assert_near(at.latitude_deg, track.points[track.n - 2].latitude_deg, 0);
    assert_true(cn_gps_track_at(&track, begin_s + 30.5, &at));
    assert_true(isnan(at.altitude_m));
    assert_false(cn_gps_track_at(&track, begin_s + 31.5, &at));
    cn_gps_track_deinit(&track);
}

static void test_antimeridian(void **state)
{
    (void)state;
    cn_gps_point at;
    assert_int_equal(read_text(GPX(POINT("-17", "179.9", "", "2024-05-01T10:00:00Z")
                                       POINT("-17", "-179.7", "", "2024-05-01T10:00:04Z"))),
                     CN_OK);
    assert_true(cn_gps_track_at(&track, track.points[0].time_s + 2, &at));
    assert_near(at.longitude_deg, -179.9, 1e-9);
    cn_gps_track_deinit(&track);
}

static void test_kml(void **state)
{
    (void)state;
    assert_int_equal(read_text("<kml xmlns:gx=\"x\"><gx:Track><when>2024-05-01T10:00:00Z</when>"
                               "<when>2024-05-01T10:00:01Z</when><gx:coord>8.1 47.2 400</gx:coord>"
                               "<gx:coord>8.2 47.3 401</gx:coord></gx:Track></kml>"),
                     CN_OK);
    assert_int_equal(track.n, 2);
    assert_near(track.points[1].longitude_deg, 8.2, 0);
    assert_near(track.points[1].latitude_deg, 47.3, 0);
    assert_near(track.points[1].altitude_m, 401, 0);
    cn_gps_track_deinit(&track);
}

static void test_srt(void **state)
{
    (void)state;
    assert_int_equal(read_text("1\r\n00:00:00,000 --> 00:00:00,033\r\n<font size=\"28\">2024-05-01 12:00:00.123\r\n"
                               "[iso: 100] [latitude: 46.12345] [longitude: -8.5] [rel_alt: 1.300 abs_alt: 512.3]"
                               "</font>\r\n\r\n2\r\n00:01:00,500 --> 00:01:00,533\r\n[latitude: 46.2] "
                               "[longtitude: -8.6] [altitude: 99.5]\r\n\r\n"),
                     CN_OK);
    assert_true(track.from_start);
    assert_int_equal(track.n, 2);
    assert_near(track.points[0].latitude_deg, 46.12345, 0);
    assert_near(track.points[0].longitude_deg, -8.5, 0);
    assert_near(track.points[0].altitude_m, 512.3, 0);
    assert_near(track.points[1].time_s, 60.5, 1e-9);
    assert_near(track.points[1].longitude_deg, -8.6, 0);
    assert_near(track.points[1].altitude_m, 99.5, 0);
    cn_gps_track_deinit(&track);
    assert_int_equal(read_text("1\n00:00:01,000 --> 00:00:02,000\nHOME(149.02,-20.25) 2017.08.05 14:11:51\n"
                               "GPS(149.0251,-20.2533,16) BAROMETER:1.9\n"),
                     CN_OK);
    assert_near(track.points[0].longitude_deg, 149.0251, 0);
    assert_near(track.points[0].latitude_deg, -20.2533, 0);
    assert_true(isnan(track.points[0].altitude_m));
    cn_gps_track_deinit(&track);
}

static void test_bad(void **state)
{
    (void)state;
    refuse("", "no track of GPS");
    refuse("a line of words", "no track of GPS");
    refuse("1\n00:00:00,000 --> 00:00:01,000\nHello there\n", "there is no place in this track");
    refuse("<gpx><trk>", "not valid XML");
    refuse("<gpx></gpx>", "there is no place in this track");
    refuse(GPX("<trkpt lat=\"47\" lon=\"8\"></trkpt>"), "no time");
    refuse(GPX(POINT("97", "8", "", "2024-05-01T10:00:00Z")), "no lat and lon on Earth");
    refuse(GPX(POINT("47", "8", "", "yesterday")), "not a date and time like 2010-05-28T02:02:09Z: \"yesterday\"");
    refuse("<kml><gx:Track xmlns:gx=\"x\"><when>2024-05-01T10:00:00Z</when></gx:Track></kml>", "1 when and 0 gx:coord");
    assert_int_equal(cn_gps_track_read(&track, "/nonexistent"), CN_ERR_IO);
}

/* One entry of GPMF. */
static size_t put(uint8_t *out, const char *key, char type, int size, int n, const void *data)
{
    const size_t bytes = (size_t)size * (size_t)n, padded = (bytes + 3) & ~(size_t)3;
    memcpy(out, key, 4);
    out[4] = (uint8_t)type;
    out[5] = (uint8_t)size;
    out[6] = (uint8_t)(n >> 8);
    out[7] = (uint8_t)n;
    memset(out + 8, 0, padded);
    memcpy(out + 8, data, bytes);
    return 8 + padded;
}

static void put_be32(uint8_t *out, int32_t v)
{
    for (int k = 0; k < 4; k++)
        out[k] = (uint8_t)((uint32_t)v >> (24 - 8 * k));
}

/* DEVC { STRM { GPSF, SCAL, GPS5 of two points } } as a HERO 5 to 10 writes it, or GPS9 of a HERO 11 and later. */
static size_t make_packet(uint8_t *out, int fix, bool nine)
{
    uint8_t scale[36], points[64], strm[256], devc[300], lock[4];
    const int32_t scales[9] = { 10000000, 10000000, 1000, 1000, 100, 1, 1000, 100, 1 };
    const int fields = nine ? 9 : 5, size = nine ? 32 : 20;
    memset(points, 0, sizeof points);
    for (int k = 0; k < fields; k++)
        put_be32(scale + 4 * k, scales[k]);
    for (int i = 0; i < 2; i++) {
        put_be32(points + i * size, 461234567 + i * 1000);
        put_be32(points + i * size + 4, -81234567);
        put_be32(points + i * size + 8, 512300);
        if (nine) points[i * size + 31] = (uint8_t)fix;
    }
    put_be32(lock, fix);
    size_t n = nine ? 0 : put(strm, "GPSF", 'L', 4, 1, lock);
    n += put(strm + n, "STNM", 'c', 1, 5, "GPS  ");
    n += put(strm + n, "SCAL", 'l', 4, fields, scale);
    n += put(strm + n, nine ? "GPS9" : "GPS5", nine ? '?' : 'l', size, 2, points);
    const size_t m = put(devc, "STRM", 0, 1, (int)n, strm);
    return put(out, "DEVC", 0, 1, (int)m, devc);
}

static void test_gpmf(void **state)
{
    (void)state;
    uint8_t packet[400];
    for (int nine = 0; nine < 2; nine++) {
        const size_t n = make_packet(packet, 3, nine);
        assert_int_equal(cn_gps_track_add_gpmf(&track, packet, n, 4, 5), CN_OK);
        assert_true(track.from_start);
        assert_int_equal(track.n, 2);
        assert_near(track.points[0].latitude_deg, 46.1234567, 1e-12);
        assert_near(track.points[0].longitude_deg, -8.1234567, 1e-12);
        assert_near(track.points[0].altitude_m, 512.3, 1e-9);
        assert_near(track.points[1].time_s, 4.5, 1e-12);
        assert_near(track.points[1].latitude_deg, 46.1235567, 1e-12);
        cn_gps_track_deinit(&track);
        /* Without a fix, and cut at every byte: no crash, no point past the end */
        assert_int_equal(cn_gps_track_add_gpmf(&track, packet, make_packet(packet, 0, nine), 4, 5), CN_OK);
        assert_int_equal(track.n, 0);
        make_packet(packet, 3, nine);
        for (size_t cut = 0; cut < n; cut++) {
            uint8_t *exact = malloc(cut + 1);
            assert_non_null(exact);
            memcpy(exact, packet, cut);
            assert_int_equal(cn_gps_track_add_gpmf(&track, exact, cut, 4, 5), CN_OK);
            assert_int_equal(track.n, 0);
            free(exact);
        }
        cn_gps_track_deinit(&track);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_gpx), cmocka_unit_test(test_antimeridian), cmocka_unit_test(test_kml),
        cmocka_unit_test(test_srt), cmocka_unit_test(test_bad),          cmocka_unit_test(test_gpmf),
    };
    return cmocka_run_group_tests(tests, text_file_make, text_file_remove);
}
