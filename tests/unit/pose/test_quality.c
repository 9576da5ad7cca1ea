/* The report on poses: places against GPS, reprojection errors, and why photos have no pose. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../bridge/colmap_database.h"
#include "../common.h"
#include "base/file.h"
#include "base/json.h"
#include "pose/quality.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The first POSED photos have a pose. What is wrong with each of the others: */
enum { POSED = 3, UNREAD = POSED, FEW, CONTRADICTS, ELSEWHERE_A, ELSEWHERE_B, WEAK, ALONE, BLURRED, N, SIZE = 64 };
#define METRES_PER_DEGREE 111319.49 /* at the equator, of WGS84 */

static char folder[64], database[96], json_path[96], page_path[96];
static cn_photo photos[N];
static cn_photo_index photo_index;
static cn_view views[POSED];
static cn_camera camera;
static cn_point point;
static cn_observation seen[2];
static cn_frame frame;

/* A chessboard, or one whose edges are wide ramps. */
static void write_photo(const char *name, bool blurred)
{
    char path[256];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    fprintf(file, "P6\n%d %d\n255\n", SIZE, SIZE);
    for (int y = 0; y < SIZE; y++)
        for (int x = 0; x < SIZE; x++) {
            const double wave = sin(0.4 * x) * sin(0.4 * y);
            const int grey = blurred ? (int)(128 + 100 * wave) : wave > 0 ? 228 : 28;
            for (int k = 0; k < 3; k++)
                fputc(grey, file);
        }
    assert_int_equal(fclose(file), 0);
}

static void make_scene(void)
{
    static const double OFF_M[POSED][3] = { { 1, 0, 0 }, { 0, -2, 0 }, { 0, 0, 40 } };
    cn_frame_init(&frame);
    frame.georeferenced = true;
    frame.n_gps = POSED;
    frame.n_inliers = POSED - 1;
    camera = (cn_camera){ 1, CN_LENS_PINHOLE, SIZE, SIZE, { 100, 100, 32, 32 } };
    for (int i = 0; i < POSED; i++) {
        views[i] = (cn_view){ .name = photos[i].name, .photo = (uint32_t)i, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
        views[i].translation[0] = -10.0 * i; /* the camera is at 10 i */
        photos[i].has_gps = photos[i].has_altitude = true;
        photos[i].longitude_deg = (10.0 * i - OFF_M[i][0]) / METRES_PER_DEGREE;
        photos[i].latitude_deg = -OFF_M[i][1] / 110574.0;
        photos[i].altitude_m = -OFF_M[i][2];
        photos[i].focal_35mm = 43.2666 * 110.0 / (SIZE * sqrt(2.0)); /* 110 px */
    }
    /* Before the first camera, seen 3 and 4 px from where it is. */
    point = (cn_point){ .xyz = { 0, 0, 5 }, .n_observations = 2 };
    seen[0] = (cn_observation){ 0, 35, 32 };
    seen[1] = (cn_observation){ 0, 32, 36 };
}

static void relate(uint32_t a, uint32_t b, uint32_t n)
{
    colmap_database_relate(database, a + 1, b + 1, n);
}

static void make_database(void)
{
    static uint8_t descriptors[128 * 100];
    colmap_database_make(database);
    for (int i = 0; i < N; i++)
        if (i != UNREAD)
            colmap_database_add(database, (uint32_t)i + 1, photos[i].name, descriptors, i == FEW ? 20 : 100);
    relate(0, 1, 80);
    relate(CONTRADICTS, 1, 60);
    relate(ELSEWHERE_A, ELSEWHERE_B, 70);
    relate(WEAK, 2, 12);
}

static int set_up(void **state)
{
    (void)state;
    static char names[N][16];
    strcpy(folder, "/tmp/conurb-quality-XXXXXX");
    if (!mkdtemp(folder)) return -1;
    snprintf(database, sizeof database, "%s/database.db", folder);
    snprintf(json_path, sizeof json_path, "%s/report.json", folder);
    snprintf(page_path, sizeof page_path, "%s/report.html", folder);
    for (int i = 0; i < N; i++) {
        snprintf(names[i], sizeof names[i], "%d&<b>.ppm", i);
        photos[i] = (cn_photo){ .name = names[i], .width = SIZE, .height = SIZE, .orientation = 1, .camera = "" };
        photos[i].focal_mm = photos[i].focal_35mm = NAN;
        write_photo(names[i], i == BLURRED);
    }
    photo_index = (cn_photo_index){ .folder = folder, .photos = photos, .n_photos = N, .n_gps = POSED };
    make_scene();
    make_database();
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    return folder_remove(folder);
}

static json_t *save(cn_quality *q, char **page)
{
    json_t *root;
    size_t size;
    assert_int_equal(cn_quality_save_json(q, json_path), CN_OK);
    assert_int_equal(cn_quality_save_page(q, page_path), CN_OK);
    assert_int_equal(cn_json_load(json_path, &root), CN_OK);
    assert_int_equal(cn_file_read(page_path, 0, page, &size), CN_OK);
    return root;
}

static double number(const json_t *object, const char *key, int at)
{
    const json_t *value = json_object_get(object, key);
    if (at >= 0) value = json_array_get(value, (size_t)at);
    return json_is_number(value) ? json_number_value(value) : NAN;
}

static void check_why(const json_t *list, int photo, const char *says)
{
    const char *why = json_string_value(json_object_get(json_array_get(list, (size_t)(photo - POSED)), "why"));
    assert_non_null(why);
    if (!strstr(why, says)) fail_msg("photo %d: \"%s\" does not say \"%s\"", photo, why, says);
}

static void check_places(const json_t *root)
{
    const json_t *list = json_object_get(root, "photos");
    assert_int_equal(json_array_size(list), POSED);
    assert_true(fabs(number(json_array_get(list, 0), "centre_minus_gps_m", 0) - 1.0) < 0.01);
    assert_true(fabs(number(json_array_get(list, 1), "centre_minus_gps_m", 1) + 2.0) < 0.01);
    assert_true(fabs(number(json_array_get(list, 2), "centre_minus_gps_m", 2) - 40.0) < 0.01);
    assert_true(json_is_true(json_object_get(json_array_get(list, 1), "agrees_with_gps")));
    assert_true(json_is_false(json_object_get(json_array_get(list, 2), "agrees_with_gps")));
    /* Of the two photos that agree. */
    assert_true(fabs(number(root, "gps_rms_m", 0) - sqrt(0.5)) < 0.01);
    assert_true(fabs(number(root, "gps_rms_m", 1) - sqrt(2.0)) < 0.01);
    assert_true(fabs(number(root, "gps_rms_m", 2)) < 0.01);
    assert_true(fabs(number(root, "mean_error_px", -1) - 3.5) < 1e-9);
    assert_true(fabs(number(json_array_get(list, 0), "error_px", -1) - 3.5) < 1e-9);
    assert_true(isnan(number(json_array_get(list, 1), "error_px", -1)));
    const json_t *lens = json_array_get(json_object_get(root, "cameras"), 0);
    assert_true(fabs(number(lens, "focal_px", -1) - 100.0) < 1e-9);
    assert_true(fabs(number(lens, "exif_focal_px", -1) - 110.0) < 1e-9);
}

static void test_report(void **state)
{
    (void)state;
    char *page;
    const cn_pose_options options = cn_pose_options_default();
    const cn_scene scene = { &camera, 1, views, POSED, &point, 1, seen, 2 };
    const cn_control_fit fit = { 0 };
    cn_colmap_choice choice = { 2, "wider pairs", database };
    cn_quality q = { .index = &photo_index,
                     .scene = &scene,
                     .frame = &frame,
                     .fit = &fit,
                     .source = "COLMAP",
                     .way = choice.way,
                     .attempt = choice.attempt,
                     .n_models = 2 };
    const cn_quality_task task = { NULL, &options, &choice, NULL };
    assert_int_equal(cn_quality_measure(&task, &q), CN_OK);
    json_t *root = save(&q, &page);
    check_places(root);
    const json_t *missing = json_object_get(root, "unregistered");
    assert_int_equal(json_array_size(missing), N - POSED);
    check_why(missing, UNREAD, "COLMAP did not read it");
    check_why(missing, FEW, "few features (20, others 100)");
    check_why(missing, CONTRADICTS, "60 matches with 1&<b>.ppm, but no pose agrees");
    check_why(missing, ELSEWHERE_A, "matches only photos without a pose (70 matches)");
    check_why(missing, ELSEWHERE_B, "matches only photos without a pose (70 matches)");
    check_why(missing, WEAK, "too few matches: 12 with 2&<b>.ppm");
    check_why(missing, ALONE, "elsewhere: no photo with a pose shows the same");
    check_why(missing, BLURRED, "blurred");
    assert_true(number(root, "attempt", -1) == 2);
    assert_non_null(strstr(page, "attempt 2 (wider pairs)"));
    assert_non_null(strstr(page, "3 of 11 photos have a pose"));
    assert_non_null(strstr(page, "12 with 2&amp;&lt;b&gt;.ppm"));
    assert_null(strstr(page, "<b>.ppm")); /* names are text, not markup */
    assert_null(strstr(page, "nan"));
    json_decref(root);
    free(page);
    cn_quality_deinit(&q);
}

/* Two groups, of which the database of one has views of 360 degree photos: it says nothing of the photos themselves. */
static void test_groups(void **state)
{
    (void)state;
    const cn_pose_options options = cn_pose_options_default();
    const cn_scene scene = { &camera, 1, views, POSED, NULL, 0, NULL, 0 };
    const cn_control_fit fit = { 0 };
    uint32_t first[] = { 0, 1, UNREAD }, second[] = { 2, ALONE };
    cn_photo_group groups[] = { { first, 3, 3 }, { second, 2, 2 } };
    cn_group_row rows[2] = { { .n = 3 }, { .n = 2 } };
    cn_group_report fates[2] = { 0 };
    const cn_grouped grouped = { { groups, 2 }, { .groups = fates, .n_groups = 2 }, rows };
    cn_colmap_choice choice = { 0 };
    cn_quality q = { .index = &photo_index,
                     .scene = &scene,
                     .frame = &frame,
                     .fit = &fit,
                     .source = "COLMAP",
                     .grouped = &grouped,
                     .n_models = 1 };
    const cn_quality_task task = { NULL, &options, &choice, folder };
    photos[2].equirectangular = photos[ALONE].equirectangular = true;
    for (uint32_t g = 0; g < 2; g++) {
        char *dir = cn_group_path(folder, g, NULL), *path = cn_group_path(folder, g, "database.db");
        assert_int_equal(cn_folder_make(dir), CN_OK);
        colmap_database_make(path);
        colmap_database_add(path, 1, g == 0 ? photos[0].name : "00000001-0-00000000.jpg", NULL, 0);
        free(dir);
        free(path);
    }
    assert_int_equal(cn_quality_measure(&task, &q), CN_OK);
    for (uint32_t i = 0; i < q.n_missing; i++) {
        if (q.missing[i].photo == UNREAD) assert_string_equal(q.missing[i].why, "COLMAP did not read it");
        if (q.missing[i].photo == ALONE) assert_string_equal(q.missing[i].why, "COLMAP found no pose");
    }
    cn_quality_deinit(&q);
}

/* Without a database the reasons are general, and without GPS there are no residuals. */
static void test_import(void **state)
{
    (void)state;
    char *page;
    const cn_pose_options options = cn_pose_options_default();
    const cn_scene scene = { &camera, 1, views, POSED, NULL, 0, NULL, 0 };
    const cn_control_fit fit = { 0 };
    cn_quality q = { .index = &photo_index,
                     .scene = &scene,
                     .frame = &frame,
                     .fit = &fit,
                     .source = "x.nvm",
                     .import = "x.nvm",
                     .n_models = 1 };
    const cn_quality_task task = { NULL, &options, NULL, NULL };
    for (int i = 0; i < POSED; i++)
        photos[i].has_gps = false;
    frame.georeferenced = false;
    assert_int_equal(cn_quality_measure(&task, &q), CN_OK);
    json_t *root = save(&q, &page);
    check_why(json_object_get(root, "unregistered"), ALONE, "the imported file has no pose of it");
    assert_true(isnan(number(root, "gps_rms_m", 0)) && isnan(number(root, "mean_error_px", -1)));
    assert_string_equal(json_string_value(json_object_get(json_object_get(root, "import"), "outcome")), "unchecked");
    assert_non_null(strstr(page, "no place on Earth"));
    assert_null(strstr(page, "nan"));
    json_decref(root);
    free(page);
    cn_quality_deinit(&q);
}

/* The left edge of a photo of all directions is its right edge too. */
static void test_sphere(void **state)
{
    (void)state;
    const cn_pose_options options = cn_pose_options_default();
    const cn_scene scene = { &camera, 1, views, POSED, &point, 1, seen, 2 };
    const cn_control_fit fit = { 0 };
    cn_quality q = {
        .index = &photo_index, .scene = &scene, .frame = &frame, .fit = &fit, .source = "x", .n_models = 1
    };
    const cn_quality_task task = { NULL, &options, NULL, NULL };
    camera = (cn_camera){ 1, CN_LENS_EQUIRECTANGULAR, 2 * SIZE, SIZE, { 2 * SIZE, SIZE } };
    point.xyz[2] = -5; /* behind the first camera: at the edge */
    seen[0] = (cn_observation){ 0, 1, 32 };
    seen[1] = (cn_observation){ 0, 2 * SIZE - 3, 32 };
    assert_int_equal(cn_quality_measure(&task, &q), CN_OK);
    assert_true(fabs(q.mean_error_px - 2) < 1e-6);
    assert_true(fabs(q.views[0].error_px - 2) < 1e-6);
    cn_quality_deinit(&q);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = { TEST(test_report), TEST(test_groups), TEST(test_import), TEST(test_sphere) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
