#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "scratch.h"
#include "segment.h"

#include "base/file.h"
#include "effect/runs.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define END                                                                                                            \
    {                                                                                                                  \
        NULL, NULL, NULL, 0                                                                                            \
    }

static cn_photo_index scan(scratch *s)
{
    cn_photo_index index;
    assert_int_equal(cn_photo_index_scan(&s->context, s->folder, &index), CN_OK);
    return index;
}

static const char *reason_of(const cn_photo_index *index, const char *name)
{
    for (uint32_t i = 0; i < index->n_rejects; i++)
        if (strcmp(index->rejects[i].name, name) == 0) return index->rejects[i].reason;
    return NULL;
}

static void photos_are_found_in_order_of_name(void **state)
{
    scratch *s = *state;
    scratch_photo(s, "b.jpg", 1, NULL);
    scratch_photo(s, "sub/deeper/a.png", 2, NULL);
    scratch_photo(s, "a.tif", 3, NULL);
    scratch_photo(s, "c.exr", 4, NULL);
    scratch_photo(s, "low.jpg", 5, NULL);
    scratch_copy(s, "low.jpg", "SHOUT.JPG", 1);
    assert_int_equal(unlink(scratch_path(s, "low.jpg")), 0);
    scratch_photo(s, ".hidden.jpg", 6, NULL);
    scratch_photo(s, ".thumbs/x.jpg", 7, NULL);
    scratch_photo(s, "masks/b.png", 8, NULL);
    assert_int_equal(cn_file_write(scratch_path(s, "notes.txt"), "x", 1), CN_OK);
    cn_photo_index index = scan(s);
    static const char *const want[] = { "SHOUT.JPG", "a.tif", "b.jpg", "c.exr", "sub/deeper/a.png" };
    assert_int_equal(index.n_photos, 5);
    assert_int_equal(index.n_rejects, 0);
    assert_int_equal(index.n_gps, 0);
    assert_non_null(strstr(s->logged, "no photo has GPS"));
    for (int i = 0; i < 5; i++) {
        assert_string_equal(index.photos[i].name, want[i]);
        assert_int_equal(index.photos[i].width, SCRATCH_W);
        assert_int_equal(index.photos[i].height, SCRATCH_H);
        assert_true(isnan(index.photos[i].time_s) && isnan(index.photos[i].exposure_s));
        assert_string_equal(index.photos[i].camera, "");
    }
    assert_true(s->reports >= 1 && s->last == 5 && s->total == 5);
    cn_photo_index_deinit(&index);
}

/* A city inside the folder of its photos: its renders are no photos. */
static void a_city_among_the_photos_is_left_out(void **state)
{
    scratch *s = *state;
    scratch_photo(s, "a.jpg", 1, NULL);
    scratch_photo(s, "town/eval/a.jpg.png", 2, NULL);
    scratch_photo(s, "town/renders/flight/00000.png", 3, NULL);
    scratch_photo(s, "square/b.jpg", 4, NULL);
    assert_int_equal(cn_file_write(scratch_path(s, "town/city.yaml"), "x", 1), CN_OK);
    cn_photo_index index = scan(s);
    assert_int_equal(index.n_photos, 2);
    assert_int_equal(index.n_rejects, 0);
    assert_string_equal(index.photos[0].name, "a.jpg");
    assert_string_equal(index.photos[1].name, "square/b.jpg");
    assert_non_null(strstr(s->logged, "left out town: the folder of a city"));
    cn_photo_index_deinit(&index);
}

/* A city made in the folder of its photos. */
static void what_a_city_made_among_its_photos_is_left_out(void **state)
{
    scratch *s = *state;
    scratch_photo(s, "a.jpg", 1, NULL);
    scratch_photo(s, "square/renders/b.jpg", 2, NULL);
    scratch_photo(s, "renders/flight/00000.png", 3, NULL);
    scratch_photo(s, "eval/a.jpg.png", 4, NULL);
    scratch_photo(s, "appearances/dusk.png", 5, NULL);
    cn_photo_index index = scan(s);
    assert_int_equal(index.n_photos, 5); /* not a city yet */
    cn_photo_index_deinit(&index);
    assert_int_equal(cn_file_write(scratch_path(s, "city.yaml"), "x", 1), CN_OK);
    index = scan(s);
    assert_int_equal(index.n_photos, 2);
    assert_int_equal(index.n_rejects, 0);
    assert_string_equal(index.photos[0].name, "a.jpg");
    assert_string_equal(index.photos[1].name, "square/renders/b.jpg");
    assert_non_null(strstr(s->logged, "without the folders that the city has made"));
    cn_photo_index_deinit(&index);
}

/* 2 x 2 pixels, 24 bits. */
static void write_bmp(scratch *s, const char *name)
{
    static const uint8_t bmp[70] = { 'B', 'M', 70, 0, 0, 0, 0,  0,         0,  0,  54,  0,   0, 0,
                                     40,  0,   0,  0, 2, 0, 0,  0,         2,  0,  0,   0,   1, 0,
                                     24,  0,   0,  0, 0, 0, 16, [54] = 10, 20, 30, 200, 100, 50 };
    assert_int_equal(cn_file_write(scratch_path(s, name), bmp, sizeof bmp), CN_OK);
}

static void further_types_are_read_and_others_are_named(void **state)
{
    scratch *s = *state;
    scratch_photo(s, "a.jpg", 1, NULL);
    scratch_photo(s, "b.tif", 2, NULL);
    scratch_photo(s, "c.exr", 3, NULL);
    write_bmp(s, "d.BMP");
    assert_int_equal(cn_file_write(scratch_path(s, "e.CR3"), "raw", 3), CN_OK);
    assert_int_equal(cn_file_write(scratch_path(s, "f.MOV"), "film", 4), CN_OK);
    cn_photo_index index = scan(s), again;
    assert_int_equal(index.n_photos, 4);
    assert_int_equal(index.photos[3].width, 2);
    assert_non_null(strstr(s->logged, "left out e.CR3: camera raw"));
    assert_non_null(strstr(s->logged, "left out f.MOV: a film; `conurb init CITY --video FILM`"));
    assert_int_equal(cn_photo_index_save(&index, scratch_path(s, "photos.json")), CN_OK);
    assert_int_equal(cn_photo_index_load(&again, scratch_path(s, "photos.json")), CN_OK);
    for (int i = 0; i < 4; i++) {
        assert_int_equal(index.photos[i].deep, i == 1 || i == 2);
        assert_int_equal(again.photos[i].deep, index.photos[i].deep);
    }
    cn_photo_index_deinit(&index);
    cn_photo_index_deinit(&again);
}

static void damaged_and_duplicate_photos_are_named_and_left_out(void **state)
{
    scratch *s = *state;
    scratch_photo(s, "good.jpg", 1, NULL);
    scratch_copy(s, "good.jpg", "again.jpg", 1);
    scratch_copy(s, "good.jpg", "cut.jpg", 0.9);
    scratch_copy(s, "good.jpg", "empty.jpg", 0);
    assert_int_equal(cn_file_write(scratch_path(s, "text.jpg"), "hello", 5), CN_OK);
    assert_int_equal(symlink("nowhere", scratch_path(s, "link.jpg")), 0);
    scratch_photo(s, "na\xefve.jpg", 2, NULL);
    cn_photo_index index = scan(s);
    assert_int_equal(index.n_photos, 1);
    assert_string_equal(index.photos[0].name, "again.jpg");
    assert_int_equal(index.n_rejects, 6);
    assert_string_equal(reason_of(&index, "good.jpg"), "same bytes as again.jpg");
    static const char *const names[] = { "cut.jpg", "empty.jpg", "text.jpg", "link.jpg", "na?ve.jpg" };
    for (int i = 0; i < 5; i++) {
        assert_non_null(reason_of(&index, names[i]));
        assert_non_null(strstr(s->logged, i < 4 ? names[i] : "na\xefve.jpg"));
    }
    assert_non_null(strstr(s->logged, "6 of 7"));
    assert_int_equal(cn_photo_index_save(&index, scratch_path(s, "photos.json")), CN_OK);
    cn_photo_index_deinit(&index);
}

static void turned_photos_have_their_upright_size(void **state)
{
    scratch *s = *state;
    for (int o = 1; o <= 8; o++) {
        char name[16];
        snprintf(name, sizeof name, "%d.jpg", o);
        const double value = o;
        const cn_oiio_attribute attributes[] = { { "Orientation", NULL, &value, 1 }, END };
        scratch_photo(s, name, (unsigned)o, attributes);
    }
    cn_photo_index index = scan(s);
    assert_int_equal(index.n_photos, 8);
    for (uint32_t i = 0; i < 8; i++) {
        assert_int_equal(index.photos[i].orientation, i + 1);
        assert_int_equal(index.photos[i].width, i < 4 ? SCRATCH_W : SCRATCH_H);
        assert_int_equal(index.photos[i].height, i < 4 ? SCRATCH_H : SCRATCH_W);
    }
    cn_photo_index_deinit(&index);
}

static void exif_is_kept(void **state)
{
    scratch *s = *state;
    static const double lat[3] = { 33, 51, 24.5 }, lon[3] = { 151, 12, 33 }, nowhere[3] = { 95, 0, 0 };
    static const double altitude = 4, below = 1;
    static const double shutter = 0.004, f = 2, iso = 200, focal = 4.5;
    const cn_oiio_attribute sydney[] = { { "GPS:Latitude", NULL, lat, 3 },
                                         { "GPS:LatitudeRef", "S", NULL, 0 },
                                         { "GPS:Longitude", NULL, lon, 3 },
                                         { "GPS:LongitudeRef", "E", NULL, 0 },
                                         { "GPS:Altitude", NULL, &altitude, 1 },
                                         { "GPS:AltitudeRef", NULL, &below, 1 },
                                         { "Exif:DateTimeOriginal", "2016:06:23 16:31:59", NULL, 0 },
                                         { "Exif:SubsecTimeOriginal", "25", NULL, 0 },
                                         { "ExposureTime", NULL, &shutter, 1 },
                                         { "FNumber", NULL, &f, 1 },
                                         { "Exif:PhotographicSensitivity", NULL, &iso, 1 },
                                         { "Exif:FocalLength", NULL, &focal, 1 },
                                         { "Make", "Acme", NULL, 0 },
                                         { "Model", "One", NULL, 0 },
                                         END };
    const cn_oiio_attribute lost[] = { { "GPS:Latitude", NULL, nowhere, 3 },
                                       { "GPS:Longitude", NULL, lon, 3 },
                                       { "Exif:DateTimeOriginal", "0000:00:00 00:00:00", NULL, 0 },
                                       END };
    scratch_photo(s, "a.jpg", 1, sydney);
    scratch_photo(s, "b.jpg", 2, lost);
    cn_photo_index index = scan(s);
    const cn_photo *p = &index.photos[0];
    assert_int_equal(index.n_gps, 1);
    assert_true(p->has_gps && p->has_altitude);
    assert_true(fabs(p->latitude_deg + (33 + 51 / 60.0 + 24.5 / 3600)) < 1e-8);
    assert_true(fabs(p->longitude_deg - (151 + 12 / 60.0 + 33 / 3600.0)) < 1e-8);
    assert_true(fabs(p->altitude_m + 4) < 1e-9);
    assert_true(fabs(p->time_s - 1466699519.25) < 1e-3);
    assert_string_equal(p->camera, "Acme One");
    assert_true(fabs(cn_photo_exposure_ev(p) - log2(0.004 * 2 / 4)) < 1e-5);
    assert_false(index.photos[1].has_gps);
    assert_true(isnan(index.photos[1].time_s));
    assert_true(isnan(cn_photo_exposure_ev(&index.photos[1])));
    assert_non_null(strstr(s->logged,
                           "photos whose GPS is no place of a camera (0, 0 or not on Earth) are used without it: 1. "
                           "The first is b.jpg"));
    assert_non_null(strstr(s->logged, "1 of 2 photos have GPS"));
    cn_photo_index_deinit(&index);
}

static void exposure_does_without_iso_and_f_number(void **state)
{
    (void)state;
    const cn_photo bare = { .exposure_s = 0.5, .iso = NAN, .f_number = NAN }, none = { .exposure_s = NAN, .iso = 100 };
    assert_true(fabs(cn_photo_exposure_ev(&bare) + 1) < 1e-12);
    assert_true(isnan(cn_photo_exposure_ev(&none)));
}

static double time_with_offset(scratch *s, const char *name, const char *clock, const char *offset)
{
    const segment_tag tags[] = { { SEGMENT_PHOTO, 0x9003, .text = clock }, { SEGMENT_PHOTO, 0x9011, .text = offset } };
    scratch_photo(s, name, (unsigned)name[0], NULL);
    segment_exif(scratch_path(s, name), tags, offset ? 2 : 1);
    cn_photo_index index = scan(s);
    const int64_t at = cn_photo_index_find(&index, name);
    assert_true(at >= 0);
    const double time = index.photos[at].time_s;
    cn_photo_index_deinit(&index);
    return time;
}

/* 2016-06-23 16:31:59 UTC is 1466699519. */
static void the_offset_from_utc_counts(void **state)
{
    scratch *s = *state;
    static const char clock[] = "2016:06:23 16:31:59";
    assert_true(time_with_offset(s, "a.jpg", clock, NULL) == 1466699519);
    assert_true(time_with_offset(s, "b.jpg", clock, "+02:00") == 1466699519 - 7200);
    assert_true(time_with_offset(s, "c.jpg", clock, "-09:30") == 1466699519 + 34200);
    assert_true(time_with_offset(s, "d.jpg", clock, "Z") == 1466699519);
    assert_true(time_with_offset(s, "e.jpg", clock, "   :  ") == 1466699519);
    assert_true(time_with_offset(s, "f.jpg", clock, "+77:00") == 1466699519);
    assert_true(isnan(time_with_offset(s, "g.jpg", "yesterday", "+02:00")));
}

/* A phone on summer time and a drone on UTC, five minutes apart: one capture run. */
static void cameras_of_two_zones_share_a_run(void **state)
{
    scratch *s = *state;
    time_with_offset(s, "drone.jpg", "2016:06:23 14:36:59", "+00:00");
    time_with_offset(s, "phone.jpg", "2016:06:23 16:31:59", "+02:00");
    cn_photo_index index = scan(s);
    float times[2] = { cn_run_time(&index.photos[0]), cn_run_time(&index.photos[1]) };
    assert_int_equal(cn_runs_find(times, 1, 2), 1);
    assert_true(times[0] == 1 && times[1] == 1);
    cn_photo_index_deinit(&index);
}

/* exiv2 does not read EXR; OpenImageIO finds its attributes. */
static void an_exr_has_what_its_attributes_say(void **state)
{
    scratch *s = *state;
    static const double shutter = 0.25, f = 4;
    const cn_oiio_attribute attributes[] = { { "ExposureTime", NULL, &shutter, 1 }, { "FNumber", NULL, &f, 1 }, END };
    scratch_photo(s, "a.exr", 1, attributes);
    cn_photo_index index = scan(s);
    assert_true(fabs(index.photos[0].exposure_s - shutter) < 1e-6 && index.photos[0].f_number == f);
    assert_true(isnan(index.photos[0].iso) && isnan(index.photos[0].time_s));
    cn_photo_index_deinit(&index);
}

static void masks_are_found_with_and_without_the_ending(void **state)
{
    scratch *s = *state;
    scratch_photo(s, "a.jpg", 1, NULL);
    scratch_photo(s, "b.jpg", 2, NULL);
    scratch_photo(s, "c.jpg", 3, NULL);
    scratch_photo(s, "sub/d.jpg", 4, NULL);
    scratch_photo(s, "masks/a.png", 5, NULL);
    scratch_photo(s, "masks/b.jpg.png", 6, NULL);
    scratch_photo(s, "masks/sub/d.png", 7, NULL);
    cn_photo_index index = scan(s);
    static const char *const want[] = { "masks/a.png", "masks/b.jpg.png", NULL, "masks/sub/d.png" };
    assert_int_equal(index.n_photos, 4);
    for (int i = 0; i < 4; i++) {
        if (want[i])
            assert_string_equal(index.photos[i].mask, want[i]);
        else
            assert_null(index.photos[i].mask);
    }
    cn_photo_index_deinit(&index);
}

static void a_bare_name_is_found_when_it_is_unique(void **state)
{
    scratch *s = *state;
    scratch_photo(s, "x/a.jpg", 1, NULL);
    scratch_photo(s, "y/a.jpg", 2, NULL);
    scratch_photo(s, "y/b.jpg", 3, NULL);
    cn_photo_index index = scan(s);
    assert_int_equal(cn_photo_index_find(&index, "y/a.jpg"), 1);
    assert_int_equal(cn_photo_index_find(&index, "b.jpg"), 2);
    assert_int_equal(cn_photo_index_find(&index, "a.jpg"), -1);
    assert_int_equal(cn_photo_index_find(&index, "c.jpg"), -1);
    cn_photo_index_deinit(&index);
}

static void nothing_to_work_with_is_said(void **state)
{
    scratch *s = *state;
    cn_photo_index index;
    assert_int_equal(cn_photo_index_scan(&s->context, scratch_path(s, "no-such-folder"), &index), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), "no-such-folder"));
    assert_int_equal(cn_photo_index_scan(NULL, s->folder, &index), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), s->folder));
    assert_int_equal(index.n_photos, 0);
    assert_null(index.photos);
    scratch_photo(s, "a.jpg", 1, NULL);
    const int stop = 1;
    s->context.stop = &stop;
    assert_int_equal(cn_photo_index_scan(&s->context, s->folder, &index), CN_ERR_INTERRUPTED);
}

static void expect_same_photo(const cn_photo *a, const cn_photo *b)
{
    assert_string_equal(a->name, b->name);
    assert_string_equal(a->camera, b->camera);
    assert_true(a->width == b->width && a->height == b->height && a->orientation == b->orientation);
    assert_true(a->hash == b->hash);
    assert_true(a->has_gps == b->has_gps && a->has_altitude == b->has_altitude);
    const double x[] = { a->time_s, a->exposure_s, a->iso, a->f_number, a->focal_mm, a->focal_35mm };
    const double y[] = { b->time_s, b->exposure_s, b->iso, b->f_number, b->focal_mm, b->focal_35mm };
    for (size_t i = 0; i < sizeof x / sizeof *x; i++)
        assert_true(x[i] == y[i] || (isnan(x[i]) && isnan(y[i])));
    if (a->has_gps) assert_true(a->latitude_deg == b->latitude_deg && a->longitude_deg == b->longitude_deg);
    if (a->has_altitude) assert_true(a->altitude_m == b->altitude_m);
    assert_int_equal(a->mask != NULL, b->mask != NULL);
    if (a->mask) assert_string_equal(a->mask, b->mask);
}

static void the_file_returns_what_was_saved(void **state)
{
    scratch *s = *state;
    static const double lat[3] = { 33, 51, 24.5 }, lon[3] = { 151, 12, 33 }, altitude = 4.1, shutter = 0.004;
    const cn_oiio_attribute placed[] = { { "GPS:Latitude", NULL, lat, 3 },
                                         { "GPS:Longitude", NULL, lon, 3 },
                                         { "GPS:Altitude", NULL, &altitude, 1 },
                                         { "ExposureTime", NULL, &shutter, 1 },
                                         END };
    scratch_photo(s, "a.jpg", 1, placed);
    scratch_photo(s, "b \"quoted\" \xc3\xbc.jpg", 2, NULL);
    scratch_photo(s, "masks/a.png", 3, NULL);
    scratch_copy(s, "a.jpg", "cut.jpg", 0.5);
    cn_photo_index saved = scan(s), loaded;
    const char *path = scratch_path(s, "photos.json");
    assert_int_equal(cn_photo_index_save(&saved, path), CN_OK);
    assert_int_equal(cn_photo_index_load(&loaded, path), CN_OK);
    assert_string_equal(saved.folder, loaded.folder);
    assert_int_equal(loaded.n_photos, 2);
    assert_int_equal(loaded.n_gps, 1);
    assert_int_equal(loaded.n_rejects, 1);
    assert_string_equal(loaded.rejects[0].name, "cut.jpg");
    assert_string_equal(loaded.rejects[0].reason, saved.rejects[0].reason);
    for (uint32_t i = 0; i < 2; i++)
        expect_same_photo(&saved.photos[i], &loaded.photos[i]);
    cn_photo_index_deinit(&saved);
    cn_photo_index_deinit(&loaded);
}

static void files_that_are_no_index_are_refused(void **state)
{
    scratch *s = *state;
    static const struct {
        const char *text, *word;
        cn_status status;
    } cases[] = {
        { "{\"version\": 99}", "newer", CN_ERR_VERSION },
        { "{\"version\": 1", "photos.json", CN_ERR_FORMAT },
        { "[]", "photos.json", CN_ERR_FORMAT },
        { "{\"version\": 1, \"folder\": \"/\", \"left_out\": [], \"photos\": [7]}", "photos.json", CN_ERR_FORMAT },
        { "{\"version\": 1, \"folder\": \"/\", \"photos\": [], \"left_out\": [{\"name\": \"a\"}]}", "reason",
          CN_ERR_FORMAT },
        { "{\"version\": 1, \"folder\": \"/\", \"left_out\": [], \"photos\": [{\"name\": \"a\", \"camera\": \"\", "
          "\"hash\": \"0\", \"width\": -5, \"height\": 5, \"orientation\": 1}]}",
          "width", CN_ERR_FORMAT },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *path = scratch_path(s, "photos.json");
        cn_photo_index index;
        assert_int_equal(cn_file_write(path, cases[i].text, strlen(cases[i].text)), CN_OK);
        assert_int_equal(cn_photo_index_load(&index, path), cases[i].status);
        assert_non_null(strstr(cn_error_message(), cases[i].word));
        assert_null(index.photos);
    }
}

#define TEST(f) cmocka_unit_test_setup_teardown(f, scratch_set_up, scratch_tear_down)
int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(a_city_among_the_photos_is_left_out),
        TEST(what_a_city_made_among_its_photos_is_left_out),
        TEST(further_types_are_read_and_others_are_named),
        TEST(photos_are_found_in_order_of_name),
        TEST(further_types_are_read_and_others_are_named),
        TEST(damaged_and_duplicate_photos_are_named_and_left_out),
        TEST(turned_photos_have_their_upright_size),
        TEST(exif_is_kept),
        TEST(exposure_does_without_iso_and_f_number),
        TEST(masks_are_found_with_and_without_the_ending),
        TEST(a_bare_name_is_found_when_it_is_unique),
        TEST(nothing_to_work_with_is_said),
        TEST(the_file_returns_what_was_saved),
        TEST(files_that_are_no_index_are_refused),
        TEST(the_offset_from_utc_counts),
        TEST(cameras_of_two_zones_share_a_run),
        TEST(an_exr_has_what_its_attributes_say),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
