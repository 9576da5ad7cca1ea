/* The pose of a photo from outside the collection, COLMAP's part played by a shell script that hands out models. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../bridge/colmap_database.h"
#include "../common.h"
#include "base/file.h"
#include "bridge/oiio.h"
#include "fake_colmap.h"
#include "kernel/kernel.h"
#include "conurb/pose.h"
#include "math/linalg.h"
#include "pose/groups.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { N = 4 };
static char folder[64], program[96], dir[96], work[96], frame_path[96], query_path[96];
static cn_photo photos[N];
static cn_photo_index photo_index;
static cn_camera camera = { 1, CN_LENS_SIMPLE_RADIAL, 64, 48, { 50, 32, 24, 0.01 } };

/* Cameras on a line, which says nothing of the turn about it, each turned another way; and the query photo above it. */
static void view_of(int i, cn_view *view)
{
    const double q[4] = { 1, 0.1 * i, -0.2, 0.05 * i * i }, centre[3] = { i, 0, i == N ? 2 : 0 };
    cn_quat_to_mat3(q, view->rotation);
    cn_mat3_vec(view->rotation, centre, view->translation);
    for (int a = 0; a < 3; a++)
        view->translation[a] = -view->translation[a];
}

static void write_model(const char *name, bool with_query, const char *as)
{
    char query_name[32];
    snprintf(query_name, sizeof query_name, "%s", as);
    cn_view views[N + 1] = { 0 };
    char path[160];
    for (int i = 0; i <= N; i++) {
        views[i].name = i < N ? photos[i].name : query_name;
        view_of(i, &views[i]);
    }
    const cn_scene scene = { .cameras = &camera, .n_cameras = 1, .views = views, .n_views = with_query ? N + 1 : N };
    snprintf(path, sizeof path, "%s/%s", folder, name);
    assert_int_equal(cn_scene_write_colmap(&scene, path), CN_OK);
}

static void write_program(const char *registrator)
{
    fake_colmap_write(program,
                      "#!/bin/sh\necho \"$@\" >> %s/calls\nfor a; do [ \"$last\" = --output_path ] && out=$a; "
                      "[ \"$last\" = --database_path ] && : >> $a; last=$a; done\ncase $1 in\n"
                      "mapper) cp -r %s/without $out/0;;\nimage_registrator) %s;;\nesac\n",
                      folder, folder, registrator);
}

static void write_registrator(const char *model)
{
    char text[160];
    snprintf(text, sizeof text, "cp %s/%s/* $out", folder, model);
    write_program(text);
}

static int set_up(void **state)
{
    (void)state;
    static float rgb[64 * 48 * 3];
    strcpy(folder, "/tmp/conurb-locate-XXXXXX");
    if (!mkdtemp(folder)) return -1;
    snprintf(program, sizeof program, "%s/colmap", folder);
    snprintf(dir, sizeof dir, "%s/poses", folder);
    snprintf(work, sizeof work, "%s/work", folder);
    snprintf(frame_path, sizeof frame_path, "%s/frame.json", folder);
    snprintf(query_path, sizeof query_path, "%s/a dusk.png", folder);
    fake_colmap_photos(photos, N, 64, 48);
    photo_index = (cn_photo_index){ .folder = folder, .photos = photos, .n_photos = N };
    for (size_t i = 0; i < sizeof rgb / sizeof *rgb; i++)
        rgb[i] = (float)(i % 7) / 7;
    if (mkdir(work, 0777) != 0 || cn_oiio_write_png(query_path, rgb, 64, 48, 3, NULL) != CN_OK) return -1;
    write_model("without", false, "");
    write_model("with", true, "conurb-query.png");
    write_registrator("with");
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    return folder_remove(folder);
}

static bool was_called(const char *word)
{
    return file_count(folder, "calls", word) > 0;
}

static void make_poses(cn_pose_options *options, cn_scene *scene)
{
    cn_pose_report report;
    options->colmap = program;
    assert_int_equal(cn_pose_run(NULL, &photo_index, dir, frame_path, options, &report), CN_OK);
    cn_pose_report_deinit(&report);
    assert_int_equal(cn_pose_load(NULL, dir, &photo_index, scene), CN_OK);
    assert_int_equal(scene->n_views, N);
}

static cn_status locate(const cn_pose_options *options, const cn_scene *scene, cn_photo_index *query, cn_scene *out)
{
    return cn_pose_locate(NULL, &(cn_pose_collection){ &photo_index, scene, dir, options }, query_path, work, query,
                          out);
}

/* As it stands to the first photo in COLMAP's model, so it stands to it in the city. */
static void check_place(const cn_scene *scene, const cn_view *found)
{
    cn_view first, query;
    double want[3], have[3], c0[3], c1[3], g[3], turn_want[9], turn_have[9], t[9];
    view_of(0, &first);
    view_of(N, &query);
    cn_view_centre(&scene->views[0], c0);
    cn_view_centre(&scene->views[1], c1);
    cn_view_centre(found, g);
    const double scale = cn_distance3(c0, c1), from[3] = { N * scale, 0, 2 * scale };
    cn_mat3_vec(first.rotation, from, want);
    for (int a = 0; a < 3; a++)
        g[a] -= c0[a];
    cn_mat3_vec(scene->views[0].rotation, g, have);
    cn_mat3_transpose(first.rotation, t);
    cn_mat3_mul(query.rotation, t, turn_want);
    cn_mat3_transpose(scene->views[0].rotation, t);
    cn_mat3_mul(found->rotation, t, turn_have);
    for (int a = 0; a < 3; a++)
        assert_true(fabs(have[a] - want[a]) < 1e-9);
    for (int a = 0; a < 9; a++)
        assert_true(fabs(turn_have[a] - turn_want[a]) < 1e-9);
}

static void test_found(void **state)
{
    (void)state;
    cn_pose_options options = cn_pose_options_default();
    options.match_with = CN_MATCH_WITH_COLMAP;
    cn_photo_index query;
    cn_scene scene, out;
    make_poses(&options, &scene);
    assert_int_equal(locate(&options, &scene, &query, &out), CN_OK);
    assert_int_equal(query.n_photos, 1);
    assert_true(out.n_views == 1 && out.views[0].photo == 0 && out.cameras[out.views[0].camera].width == 64);
    check_place(&scene, &out.views[0]);
    char call[320]; /* the collection's features are left alone */
    snprintf(call, sizeof call, "feature_extractor --database_path %s/database.db --image_path %s/photo", work, work);
    assert_true(was_called(call));
    cn_scene_deinit(&out);
    cn_photo_index_deinit(&query);
    cn_scene_deinit(&scene);
}

/* A query photo at 10 N, 179.999 W. */
static void write_query_with_gps(void)
{
    static const double latitude[3] = { 10, 0, 0 }, longitude[3] = { 179, 59, 56.4 };
    static float rgb[64 * 48 * 3];
    const cn_oiio_attribute gps[] = { { "GPS:Latitude", NULL, latitude, 3 },
                                      { "GPS:LatitudeRef", "N", NULL, 0 },
                                      { "GPS:Longitude", NULL, longitude, 3 },
                                      { "GPS:LongitudeRef", "W", NULL, 0 },
                                      { NULL, NULL, NULL, 0 } };
    snprintf(query_path, sizeof query_path, "%s/west.jpg", folder);
    assert_int_equal(cn_oiio_write_jpeg(query_path, rgb, 64, 48, gps), CN_OK);
}

static void put_gps(cn_photo *photo, double longitude_deg)
{
    photo->has_gps = true;
    photo->latitude_deg = 10;
    photo->longitude_deg = longitude_deg;
}

/* Looks for the query photo, and checks the first letters of the photos that it is matched with, in their order. */
static void check_matched(const cn_pose_options *how, const cn_scene *scene, const char *letters)
{
    cn_photo_index query;
    cn_scene out;
    char path[160], *text;
    size_t size;
    const cn_status status = locate(how, scene, &query, &out); /* COLMAP finds another photo */
    if (status != CN_ERR_DATA) fail_msg("%s", cn_error_message());
    snprintf(path, sizeof path, "%s/pairs.txt", work);
    assert_int_equal(cn_file_read(path, 0, &text, &size), CN_OK);
    const char *line = text;
    for (; *letters; letters++, line = strchr(line, '\n') + 1)
        if (strncmp(line, "conurb-query.jpg ", 17) != 0 || line[17] != *letters) fail_msg("%c: %s", *letters, line);
    assert_string_equal(line, "");
    free(text);
}

/* The photos to match with are the nearest ones, also across 180 degrees. */
static void test_nearest_across_the_antimeridian(void **state)
{
    (void)state;
    static const double longitudes[N] = { -179.9, 179.99, 0, 179.999 };
    cn_pose_options options = cn_pose_options_default();
    options.match_with = CN_MATCH_WITH_COLMAP;
    cn_scene scene;
    make_poses(&options, &scene);
    write_query_with_gps();
    for (int i = 0; i < N; i++)
        put_gps(&photos[i], longitudes[i]);
    check_matched(&options, &scene, "dbac");
    cn_scene_deinit(&scene);
}

/* Where the query photo has GPS, but few of the others have, all are taken in even steps, not the first ones by name.
 * Where most have it, the others come last. */
static void test_few_with_gps(void **state)
{
    (void)state;
    enum { SEVEN = 7 };
    cn_photo seven[SEVEN];
    cn_view views[SEVEN] = { 0 };
    const cn_scene posed = { .cameras = &camera, .n_cameras = 1, .views = views, .n_views = SEVEN };
    cn_pose_options options = cn_pose_options_default();
    options.match_with = CN_MATCH_WITH_COLMAP;
    options.colmap = program;
    options.attempts = 1;
    assert_int_equal(mkdir(dir, 0777), 0);
    fake_colmap_photos(seven, SEVEN, 64, 48);
    photo_index = (cn_photo_index){ .folder = folder, .photos = seven, .n_photos = SEVEN };
    for (uint32_t i = 0; i < SEVEN; i++)
        views[i] = (cn_view){ .name = seven[i].name, .photo = i };
    write_query_with_gps();
    put_gps(&seven[5], 0);
    check_matched(&options, &posed, "acegbdf");
    for (int i = 0; i < 4; i++)
        put_gps(&seven[i], 170 + i);
    snprintf(work, sizeof work, "%s/work2", folder);
    assert_int_equal(mkdir(work, 0777), 0);
    check_matched(&options, &posed, "dcbafeg");
}

/* Two groups, of which the second one has a model. */
static void make_groups(void)
{
    uint32_t first[] = { 0, 1, 2 }, second[] = { 3, 1, 2 };
    cn_photo_group list[] = { { first, 3, 3 }, { second, 3, 1 } };
    const cn_photo_groups groups = { list, 2 };
    char path[160];
    snprintf(path, sizeof path, "%s/groups/002/model", dir);
    assert_int_equal(cn_folder_make(path), CN_OK);
    snprintf(path, sizeof path, "%s/groups/002/model/images.bin", dir);
    assert_int_equal(cn_file_write(path, "", 0), CN_OK);
    snprintf(path, sizeof path, "%s/groups/groups.json", dir);
    assert_int_equal(cn_photo_groups_save(&groups, "key", "GPS", path), CN_OK);
}

/* In a collection that was posed in groups, the photo is found in the nearest one. The collection is not posed again.
 */
static void test_found_in_a_group(void **state)
{
    (void)state;
    cn_pose_options options = cn_pose_options_default();
    options.match_with = CN_MATCH_WITH_COLMAP;
    cn_photo_index query;
    cn_scene scene, out;
    char whole[160];
    make_poses(&options, &scene);
    snprintf(whole, sizeof whole, "--database_path %s/database.db", dir);
    const size_t n_whole = file_count(folder, "calls", whole);
    make_groups();
    options.group_photos = 1;
    assert_int_equal(locate(&options, &scene, &query, &out), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "a dusk.png: the collection was posed in groups"));
    write_query_with_gps();
    for (int i = 0; i < N; i++)
        put_gps(&photos[i], -179);
    write_model("with", true, "conurb-query.jpg");
    snprintf(work, sizeof work, "%s/work2", folder);
    assert_int_equal(mkdir(work, 0777), 0);
    if (locate(&options, &scene, &query, &out) != CN_OK) fail_msg("%s", cn_error_message());
    check_place(&scene, &out.views[0]);
    assert_int_equal(file_count(folder, "calls", whole), n_whole);
    assert_true(was_called("groups/002/database.db"));
    assert_false(was_called("groups/001"));
    cn_scene_deinit(&out);
    cn_photo_index_deinit(&query);
    cn_scene_deinit(&scene);
}

/* Imported poses, in a frame of their own: COLMAP goes through the collection first, beside them. */
static void test_found_among_imported(void **state)
{
    (void)state;
    cn_pose_options options = cn_pose_options_default();
    options.match_with = CN_MATCH_WITH_COLMAP;
    cn_photo_index query;
    cn_scene scene, out;
    char import[96], path[160];
    snprintf(import, sizeof import, "%s/without", folder);
    options.import = import;
    make_poses(&options, &scene);
    assert_false(was_called("mapper"));
    const double turn[9] = { 0, -1, 0, 1, 0, 0, 0, 0, 1 }, shift[3] = { 100, 20, 3 };
    for (uint32_t i = 0; i < scene.n_views; i++) { /* as if they were imported in metres */
        cn_view *v = &scene.views[i];
        double centre[3], moved[3], r[9], t[9];
        cn_view_centre(v, centre);
        cn_mat3_vec(turn, centre, moved);
        cn_mat3_transpose(turn, t);
        cn_mat3_mul(v->rotation, t, r);
        memcpy(v->rotation, r, sizeof r);
        for (int a = 0; a < 3; a++)
            moved[a] = -(7 * moved[a] + shift[a]);
        cn_mat3_vec(r, moved, v->translation);
    }
    assert_int_equal(locate(&options, &scene, &query, &out), CN_OK);
    check_place(&scene, &out.views[0]);
    assert_true(was_called("mapper"));
    snprintf(path, sizeof path, "%s/colmap/database.db", dir);
    assert_true(cn_file_exists(path));
    cn_scene_deinit(&out);
    cn_photo_index_deinit(&query);
    scene.n_views = 1; /* a city that shares one photo with what COLMAP posed */
    snprintf(work, sizeof work, "%s/work2", folder);
    assert_int_equal(mkdir(work, 0777), 0);
    assert_int_equal(locate(&options, &scene, &query, &out), CN_ERR_DATA);
    scene.n_views = N;
    cn_scene_deinit(&scene);
}

/* Matched here: the database that COLMAP verifies and registers from has the query photo's matches. */
static void test_matched_here(void **state)
{
    (void)state;
    static const char *const names[] = { "a.jpg", "b.jpg", "c.jpg", "d.jpg", "conurb-query.png" };
    static uint8_t bytes[20][CN_DESCRIPTOR];
    cn_pose_options options = cn_pose_options_default();
    cn_photo_index query;
    cn_scene scene, out;
    char path[160];
    options.match_with = CN_MATCH_WITH_COLMAP;
    make_poses(&options, &scene);
    for (int i = 0; i < 20; i++) { /* each of length 512, at right angles to the others */
        bytes[i][6 * i] = bytes[i][6 * i + 1] = bytes[i][6 * i + 2] = bytes[i][6 * i + 3] = 255;
        bytes[i][6 * i + 4] = 45;
    }
    snprintf(path, sizeof path, "%s/database.db", dir);
    assert_int_equal(unlink(path), 0);
    colmap_database_make(path);
    for (uint32_t i = 0; i < 5; i++)
        colmap_database_add(path, i + 1, names[i], bytes[0], i == 2 ? 9 : 20);
    options.match_with = CN_MATCH_WITH_CONURB;
    assert_int_equal(locate(&options, &scene, &query, &out), CN_OK);
    check_place(&scene, &out.views[0]);
    snprintf(path, sizeof path, "%s/database.db", work);
    /* Photo 5 is the query. Photo 3 has too few features for a match. */
    assert_int_equal(colmap_database_ask(path, "SELECT COUNT(*) FROM matches WHERE pair_id % 2147483647 = 5"), N);
    assert_int_equal(colmap_database_ask(path, "SELECT SUM(rows) FROM matches WHERE pair_id % 2147483647 = 5"),
                     20 * (N - 1));
    assert_int_equal(
        colmap_database_ask(path, "SELECT COUNT(*) FROM two_view_geometries WHERE pair_id % 2147483647 = 5"), 1);
    assert_true(was_called("matches_importer"));
    cn_scene_deinit(&out);
    cn_photo_index_deinit(&query);
    cn_scene_deinit(&scene);
}

static void test_not_found(void **state)
{
    (void)state;
    cn_pose_options options = cn_pose_options_default();
    options.match_with = CN_MATCH_WITH_COLMAP;
    cn_photo_index query;
    cn_scene scene, out;
    make_poses(&options, &scene);
    write_registrator("without");
    assert_int_equal(locate(&options, &scene, &query, &out), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "a dusk.png"));
    assert_true(out.n_views == 0 && query.n_photos == 0);
    write_program("echo no luck; exit 3");
    snprintf(work, sizeof work, "%s/work2", folder);
    assert_int_equal(mkdir(work, 0777), 0);
    assert_int_equal(locate(&options, &scene, &query, &out), CN_ERR_TOOL);
    assert_non_null(strstr(cn_error_message(), "no luck"));
    assert_int_equal(cn_file_write(query_path, "no photo", 8), CN_OK);
    snprintf(work, sizeof work, "%s/work3", folder);
    assert_int_equal(mkdir(work, 0777), 0);
    assert_int_equal(locate(&options, &scene, &query, &out), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "a dusk.png"));
    cn_scene_deinit(&scene);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = { TEST(test_found),
                                        TEST(test_nearest_across_the_antimeridian),
                                        TEST(test_few_with_gps),
                                        TEST(test_found_in_a_group),
                                        TEST(test_found_among_imported),
                                        TEST(test_matched_here),
                                        TEST(test_not_found) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
