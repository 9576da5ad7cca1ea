/* Attempts of COLMAP, whose part a shell script plays: which follow, which is kept, and what a rerun does again. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../bridge/colmap_database.h"
#include "../common.h"
#include "base/file.h"
#include "conurb/pose.h"
#include "fake_colmap.h"
#include "pose/from_photos.h"
#include "pose/ladder.h"
#include "pose/panorama.h"
#include "pose/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum { N = 4, MANY = 12, MOST_POINTS = 20 };
static char folder[64], program[96], work[96], logged[LOGGED];
static cn_photo photos[MANY];
static cn_photo_index photo_index;
static cn_pose_options options;

static const cn_context CONTEXT = { .log = log_append, .user = logged };

/* FOLDER/NAME: a model of the first n photos, whose points are off_px from where they were seen. */
static void make_points(const char *name, uint32_t n, uint32_t n_points, const cn_camera *camera, double off_px)
{
    char path[128];
    cn_view views[N];
    cn_observation seen[MOST_POINTS * N];
    cn_point points[MOST_POINTS];
    cn_camera cameras[1] = { *camera };
    for (uint32_t i = 0; i < n; i++)
        views[i] = (cn_view){ .name = photos[i].name, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
    for (uint32_t p = 0; p < n_points; p++) {
        points[p] = (cn_point){ .xyz = { 0, 0, 5 }, .first_observation = p * n, .n_observations = n };
        for (uint32_t i = 0; i < n; i++)
            seen[p * n + i] = (cn_observation){ i, (float)(320 + off_px), 240 };
    }
    const cn_scene scene = { cameras, 1, views, n, points, n_points, seen, (uint64_t)n_points * n };
    snprintf(path, sizeof path, "%s/%s", folder, name);
    assert_int_equal(cn_scene_write_colmap(&scene, path), CN_OK);
}

static void make_model(const char *name, uint32_t n, const cn_camera *camera, double off_px)
{
    make_points(name, n, 1, camera, off_px);
}

/* The script: `mappers` are cases of $out, the folder that the mapper fills. */
static void write_program(const char *mappers)
{
    fake_colmap_write(program,
                      "#!/bin/sh\necho \"$@\" >> %s/calls\nout=\nfor a; do [ \"$last\" = --output_path ] && out=$a; "
                      "[ \"$last\" = --database_path ] && [ ! -e $a ] && cp %s/made.db $a; last=$a; done\n"
                      "none() { echo 'ERROR: failed to create sparse model'; exit 1; }\n"
                      "give() { mkdir -p $out/0; cp %s/$1/* $out/0; }\n"
                      "case $1 in\nmapper) case $out in\n%s\nesac;;\n"
                      "bundle_adjuster) cp ${out}-start/* $out;;\nesac\n",
                      folder, folder, folder, mappers);
}

/* fx fy cx cy k1 k2 p1 p2 = 2 1 1 1 1 1 1 1 */
#define ONE "000000000000F03F"
#define OPENCV_CAMERA                                                                                                  \
    "INSERT INTO cameras(camera_id, model, width, height, params, prior_focal_length) "                                \
    "VALUES(1, 4, 640, 480, X'0000000000000040" ONE ONE ONE ONE ONE ONE ONE "', 0)"

static int set_up(void **state)
{
    (void)state;
    char made[96];
    static char images[96];
    const cn_camera camera = { 1, CN_LENS_PINHOLE, 640, 480, { 500, 500, 320, 240 } };
    strcpy(folder, "/tmp/conurb-ladder-XXXXXX");
    if (!mkdtemp(folder)) return -1;
    snprintf(program, sizeof program, "%s/colmap", folder);
    snprintf(work, sizeof work, "%s/poses", folder);
    snprintf(images, sizeof images, "%s/images", folder);
    fake_colmap_photos(photos, MANY, 640, 480);
    photo_index = (cn_photo_index){ .folder = images, .photos = photos, .n_photos = N };
    options = cn_pose_options_default();
    options.match_with = CN_MATCH_WITH_COLMAP;
    options.colmap = program;
    logged[0] = '\0';
    snprintf(made, sizeof made, "%s/made.db", folder);
    colmap_database_make(made);
    colmap_database_run(made, OPENCV_CAMERA);
    make_model("all", N, &camera, 1.0);
    make_model("three", 3, &camera, 1.0);
    make_model("three-better", 3, &camera, 0.25);
    make_model("two", 2, &camera, 0.1);
    if (mkdir(work, 0700) != 0) return -1;
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    return folder_remove(folder);
}

static cn_status run(cn_colmap_result *result)
{
    const cn_colmap_task task = { .ctx = &CONTEXT, .index = &photo_index, .dir = work, .options = &options };
    return cn_colmap_poses(&task, result);
}

static size_t calls(const char *word)
{
    return file_count(folder, "calls", word);
}

static bool ends_with(const char *text, const char *end)
{
    const size_t n = strlen(text), m = strlen(end);
    return n >= m && strcmp(text + n - m, end) == 0;
}

/* The first attempt suffices: nothing else runs. */
static void test_first(void **state)
{
    (void)state;
    cn_colmap_result result;
    write_program("*) give all;;");
    assert_int_equal(run(&result), CN_OK);
    assert_int_equal(calls("mapper "), 1);
    assert_int_equal(calls("feature_extractor"), 1);
    assert_true(ends_with(result.model, "/poses/sparse/0"));
    assert_true(ends_with(result.database, "/poses/database.db"));
    assert_int_equal(colmap_database_ask(result.database, "SELECT model FROM cameras"), 4);
    assert_non_null(strstr(logged, "attempt 1 (COLMAP's defaults): 4 of 4 photos, 1 sparse points, 1.00 px"));
    assert_null(strstr(logged, "attempt 2"));
    cn_colmap_result_deinit(&result);
}

/* The first finds nothing, the second all. A rerun maps neither again. */
static void test_second(void **state)
{
    (void)state;
    cn_colmap_result result;
    write_program("*sparse) none;;\n*sparse-2) give all;;");
    for (int times = 0; times < 2; times++) {
        assert_int_equal(run(&result), CN_OK);
        /* f cx cy k */
        assert_int_equal(colmap_database_ask(result.database,
                                             "SELECT COUNT(*) FROM cameras WHERE model = 2 AND params = "
                                             "X'0000000000000040" ONE ONE "0000000000000000'"),
                         1);
        assert_true(ends_with(result.model, "/poses/sparse-2/0"));
        cn_colmap_result_deinit(&result);
        assert_int_equal(calls("mapper "), 2);
        assert_int_equal(calls("--Mapper.init_max_forward_motion 0.99"), 1);
        assert_int_equal(calls("--Mapper.min_model_size 3"), 1);
        assert_int_equal(calls("feature_extractor"), 1);
    }
    assert_non_null(strstr(logged, "attempt 1 (COLMAP's defaults): none of 4 photos"));
    assert_non_null(strstr(logged, "attempt 2 (a start from forward motion and small angles): 4 of 4 photos"));
}

/* No attempt has all photos: all are made; the one with the most photos is kept, and its features go with it. */
static void test_last(void **state)
{
    (void)state;
    cn_colmap_result result;
    write_program("*sparse) give two;;\n*sparse-2) none;;\n*sparse-3) give two;;\n*sparse-4) give three;;");
    for (int times = 0; times < 2; times++) {
        assert_int_equal(run(&result), CN_OK);
        assert_true(ends_with(result.model, "/attempt-4/sparse-4/0"));
        assert_true(ends_with(result.database, "/attempt-4/database.db"));
        cn_colmap_result_deinit(&result);
        assert_int_equal(calls("mapper "), 4);
        assert_int_equal(calls("feature_extractor"), 2);
        assert_int_equal(calls("--SiftExtraction.max_num_features 16384"), 1);
        assert_int_equal(calls("--SiftExtraction.estimate_affine_shape 1"), 1);
        assert_int_equal(calls("--SiftMatching.guided_matching 1"), 1);
    }
}

/* Of models with as many photos, the one with the smaller error. */
static void test_smaller_error(void **state)
{
    (void)state;
    cn_colmap_result result;
    write_program("*sparse) give three;;\n*sparse-2) give three-better;;\n*sparse-3) give three;;\n*) none;;");
    assert_int_equal(run(&result), CN_OK);
    assert_true(ends_with(result.model, "/poses/sparse-2/0"));
    cn_colmap_result_deinit(&result);
}

/* Or the one with many more points, whose error is hardly larger. */
static void test_more_points(void **state)
{
    (void)state;
    cn_colmap_result result;
    const cn_camera camera = { 1, CN_LENS_PINHOLE, 640, 480, { 500, 500, 320, 240 } };
    make_points("three-few", 3, 8, &camera, 0.54);
    make_points("three-many", 3, MOST_POINTS, &camera, 0.57);
    write_program("*sparse) give three-few;;\n*sparse-2) give three-many;;\n*sparse-3) give three-few;;\n*) none;;");
    assert_int_equal(run(&result), CN_OK);
    assert_true(ends_with(result.model, "/poses/sparse-2/0"));
    cn_colmap_result_deinit(&result);
}

/* Views that hardly any point holds do not count: the last two see four of the points only. */
static void test_unsupported(void **state)
{
    (void)state;
    cn_colmap_result result;
    cn_scene scene;
    char path[128];
    const cn_camera camera = { 1, CN_LENS_PINHOLE, 640, 480, { 500, 500, 320, 240 } };
    make_points("three-held", 3, MOST_POINTS, &camera, 0.9);
    make_points("two-held", N, MOST_POINTS, &camera, 0.5);
    snprintf(path, sizeof path, "%s/two-held", folder);
    assert_int_equal(cn_scene_read_colmap(&scene, path), CN_OK);
    for (uint32_t p = 4; p < scene.n_points; p++)
        scene.points[p].n_observations = 2;
    assert_int_equal(cn_scene_write_colmap(&scene, path), CN_OK);
    cn_scene_deinit(&scene);
    write_program("*sparse) give two-held;;\n*sparse-2) give three-held;;\n*) none;;");
    assert_int_equal(run(&result), CN_OK);
    assert_true(ends_with(result.model, "/poses/sparse-2/0"));
    assert_non_null(strstr(logged, "attempt 1 (COLMAP's defaults): 2 of 4 photos, 20 sparse points"));
    cn_colmap_result_deinit(&result);
}

/* All photos with a large error are not enough: the next attempt finds them with a smaller one. */
static void test_doubtful(void **state)
{
    (void)state;
    cn_colmap_result result;
    const cn_camera camera = { 1, CN_LENS_PINHOLE, 640, 480, { 500, 500, 320, 240 } };
    make_model("bent", N, &camera, 2.5);
    write_program("*sparse) give bent;;\n*sparse-2) give all;;\n*) none;;");
    assert_int_equal(run(&result), CN_OK);
    assert_true(ends_with(result.model, "/poses/sparse-2/0"));
    assert_int_equal(calls("mapper "), 2);
    cn_colmap_result_deinit(&result);
}

/* A group: a photo without a pose is looked for again when it is in the core, not when it is a neighbour's. */
static void test_core(void **state)
{
    (void)state;
    const bool first[N] = { true, false, false, false }, last[N] = { false, false, false, true };
    cn_colmap_task task = { .ctx = &CONTEXT, .index = &photo_index, .dir = work, .options = &options, .core = first };
    cn_colmap_result result;
    options.attempts = 2;
    write_program("*sparse) give three;;\n*sparse-2) give all;;\n*) none;;");
    assert_int_equal(cn_colmap_poses(&task, &result), CN_OK);
    assert_true(ends_with(result.model, "/poses/sparse/0"));
    assert_int_equal(calls("mapper "), 1);
    cn_colmap_result_deinit(&result);
    task.core = last;
    assert_int_equal(cn_colmap_poses(&task, &result), CN_OK);
    assert_true(ends_with(result.model, "/poses/sparse-2/0"));
    assert_int_equal(calls("mapper "), 2);
    cn_colmap_result_deinit(&result);
}

/* The name under which COLMAP sees a view of photo i, whose hash is i. */
static char *name_of_view(uint32_t i, uint32_t k)
{
    char *name = cn_format("%08u-%u-%08x.jpg", i, k, i);
    assert_non_null(name);
    return name;
}

/* A group of photos of all directions: the core has photos, COLMAP has views. The last photo is the core, and the first
 * attempt has all views but its own. */
static void test_core_of_views(void **state)
{
    (void)state;
    bool core[N * CN_PANORAMA_VIEWS] = { [N - 1] = true }; /* what lies behind the photos is none of theirs */
    cn_view views[N * CN_PANORAMA_VIEWS] = { 0 };
    cn_camera camera = { 1, CN_LENS_SIMPLE_PINHOLE, 204, 204, { 102, 102, 102 } };
    const cn_colmap_task task = {
        .ctx = &CONTEXT, .index = &photo_index, .dir = work, .options = &options, .core = core
    };
    cn_scene scene = { .cameras = &camera, .n_cameras = 1, .views = views };
    cn_frame frame;
    uint32_t n_models;
    char path[192];
    for (uint32_t i = 0; i < N; i++) {
        photos[i].equirectangular = true;
        for (uint32_t k = 0; k < CN_PANORAMA_VIEWS; k++) {
            cn_view *view = &views[CN_PANORAMA_VIEWS * i + k];
            view->name = name_of_view(i, k);
            cn_panorama_view_rotation(k, view->rotation);
            snprintf(path, sizeof path, "%s/rig-views", work);
            assert_int_equal(cn_folder_make(path), CN_OK);
            snprintf(path, sizeof path, "%s/rig-views/%s", work, view->name);
            assert_int_equal(cn_file_write(path, "", 0), CN_OK); /* it is there, so it is not cut */
        }
    }
    scene.n_views = (N - 1) * CN_PANORAMA_VIEWS;
    snprintf(path, sizeof path, "%s/others", folder);
    assert_int_equal(cn_scene_write_colmap(&scene, path), CN_OK);
    scene.n_views = N * CN_PANORAMA_VIEWS;
    snprintf(path, sizeof path, "%s/every-view", folder);
    assert_int_equal(cn_scene_write_colmap(&scene, path), CN_OK);
    options.attempts = 2;
    write_program("*sparse-fixed-focal) give others;;\n*) give every-view;;");
    assert_int_equal(cn_pose_from_photos(&task, &scene, &frame, &n_models), CN_OK);
    assert_int_equal(calls("mapper "), 2);
    assert_int_equal(scene.n_views, N);
    cn_scene_deinit(&scene);
    for (uint32_t v = 0; v < N * CN_PANORAMA_VIEWS; v++)
        free(views[v].name);
}

/* A photo that matches no other gets no pose from the same matches. New features may match. */
static void test_connected(void **state)
{
    (void)state;
    cn_colmap_result result;
    char made[96];
    snprintf(made, sizeof made, "%s/made.db", folder);
    for (int i = 0; i < N; i++)
        colmap_database_add(made, (uint32_t)i + 1, photos[i].name, NULL, 0);
    colmap_database_relate(made, 1, 3, 90);
    colmap_database_relate(made, 2, 3, 90);
    write_program("*) give three;;");
    assert_int_equal(run(&result), CN_OK);
    assert_int_equal(calls("feature_extractor"), 2);
    assert_int_equal(calls("mapper "), 2);
    cn_colmap_result_deinit(&result);
    /* With a match it is looked for again. */
    snprintf(made, sizeof made, "%s/poses/database.db", folder);
    colmap_database_relate(made, 3, 4, 90);
    assert_int_equal(run(&result), CN_OK);
    assert_int_equal(calls("mapper "), 4);
    cn_colmap_result_deinit(&result);
}

/* An attempt that fails does not lose what others found; the log says so. */
static void test_failure(void **state)
{
    (void)state;
    cn_colmap_result result;
    write_program("*sparse-4) kill -9 $$;;\n*) give two;;");
    assert_int_equal(run(&result), CN_OK);
    assert_true(ends_with(result.model, "/poses/sparse/0"));
    assert_non_null(strstr(logged, "attempt 4 (more features, of affine shape, with guided matches) failed"));
    assert_non_null(strstr(logged, "signal 9"));
    cn_colmap_result_deinit(&result);
    write_program("*) none;;");
    assert_int_equal(cn_folder_remove(work), CN_OK);
    assert_int_equal(cn_folder_make(work), CN_OK);
    assert_int_equal(run(&result), CN_ERR_DATA);
    assert_null(result.model);
    assert_non_null(strstr(cn_error_message(), "finds no poses"));
}

static void test_one_attempt(void **state)
{
    (void)state;
    cn_colmap_result result;
    options.attempts = 1;
    write_program("*) give two;;");
    assert_int_equal(run(&result), CN_OK);
    assert_int_equal(calls("mapper "), 1);
    cn_colmap_result_deinit(&result);
}

/* Focal lengths that differ by a tenth: one focal length is adjusted instead. */
static void test_skewed_lens(void **state)
{
    (void)state;
    cn_colmap_result result;
    cn_scene scene;
    const cn_camera camera = { 1, CN_LENS_OPENCV, 640, 480, { 550, 500, 320, 240, 0.02, 0, 0, 0 } };
    make_model("skewed", N, &camera, 1.0);
    write_program("*) give skewed;;");
    for (int times = 0; times < 2; times++) {
        assert_int_equal(run(&result), CN_OK);
        assert_true(ends_with(result.model, "/poses/sparse-one-focal"));
        assert_int_equal(calls("bundle_adjuster"), 1);
        assert_int_equal(calls("--BundleAdjustment.refine_focal_length 1"), 1);
        assert_int_equal(cn_scene_read_colmap(&scene, result.model), CN_OK);
        assert_int_equal(scene.cameras[0].lens, CN_LENS_SIMPLE_RADIAL);
        assert_true(fabs(scene.cameras[0].params[0] - sqrt(550 * 500)) < 1e-9);
        cn_scene_deinit(&scene);
        cn_colmap_result_deinit(&result);
    }
    assert_non_null(strstr(logged, "550 across and 500 down"));
}

/* An OPENCV camera of 640 x 480 with focal lengths of 550, in the middle. */
#define CAMERA_OF_550                                                                                                  \
    "INSERT INTO cameras(camera_id, model, width, height, params, prior_focal_length) VALUES(1, 4, 640, 480, "         \
    "X'0000000000308140000000000030814000000000000074400000000000006E40"                                               \
    "0000000000000000000000000000000000000000000000000000000000000000', 1)"

/* A block of photos that look straight down, with GPS and a focal length: adjusted with that and a simple lens, not
 * mapped again. */
static void test_straight_down(void **state)
{
    (void)state;
    cn_camera camera = { 1, CN_LENS_OPENCV, 640, 480, { 500, 500, 320, 240, 0.02, 0.01, 0.003, 0.004 } };
    cn_view views[N];
    cn_pose_report report;
    cn_scene scene;
    cn_frame frame;
    cn_observation seen[N];
    cn_point ground = { .xyz = { 0.5, 0.5, 0 }, .n_observations = N };
    char model[128], made[96], frame_path[128];
    snprintf(frame_path, sizeof frame_path, "%s/frame.json", folder);
    snprintf(made, sizeof made, "%s/made.db", folder);
    colmap_database_run(made, "DELETE FROM cameras");
    colmap_database_run(made, CAMERA_OF_550);
    for (int i = 0; i < N; i++)
        colmap_database_add(made, (uint32_t)i + 1, photos[i].name, NULL, 0);
    for (int i = 0; i < N; i++) {
        double east = i % 2, north = i / 2;
        views[i] = (cn_view){ .name = photos[i].name,
                              .rotation = { 1, 0, 0, 0, -1, 0, 0, 0, -1 },
                              .translation = { -east, north, 10 } };
        photos[i].has_gps = photos[i].has_altitude = true;
        photos[i].latitude_deg = 46.0 + 1e-3 * north;
        photos[i].longitude_deg = 8.0 + 1.436e-3 * east; /* as many metres */
        photos[i].focal_mm = 3.6;
        seen[i] = (cn_observation){ (uint32_t)i, 320, 240 };
    }
    photo_index.n_gps = N;
    scene = (cn_scene){ &camera, 1, views, N, &ground, 1, seen, N };
    snprintf(model, sizeof model, "%s/down", folder);
    assert_int_equal(cn_scene_write_colmap(&scene, model), CN_OK);
    options.attempts = 1;
    write_program("*) give down;;");
    for (int times = 0; times < 2; times++) { /* the second time nothing is left to do */
        assert_int_equal(cn_pose_run(&CONTEXT, &photo_index, work, frame_path, &options, &report), CN_OK);
        assert_int_equal(report.n_registered, N);
        cn_pose_report_deinit(&report);
        assert_int_equal(calls("matches_importer"), 1);
        assert_int_equal(calls("ba_refine_focal_length 1"), 1);
        assert_int_equal(calls("mapper --database_path"), 1);
        assert_int_equal(calls("BundleAdjustment.refine_focal_length 0"), 2); /* and with the lens that it has */
        assert_int_equal(calls("bundle_adjuster"), 2);
    }
    assert_int_equal(cn_pose_load(NULL, work, &photo_index, &scene), CN_OK);
    assert_int_equal(scene.cameras[0].lens, CN_LENS_SIMPLE_RADIAL);
    assert_true(scene.cameras[0].params[0] == 550.0 && scene.cameras[0].params[3] == 0.02);
    /* A lens that is 1.1 times as long shows the ground as large from 1.1 times as high. */
    double a[3], b[3];
    cn_view_centre(&scene.views[0], a);
    cn_view_centre(&scene.views[1], b);
    assert_true(fabs((a[2] - scene.points[0].xyz[2]) / hypot(b[0] - a[0], b[1] - a[1]) - 11.0) < 1e-3);
    assert_int_equal(cn_frame_load(&frame, frame_path), CN_OK);
    assert_true(frame.georeferenced && frame.nadir_ambiguous);
    cn_scene_deinit(&scene);
}

/* A block of MANY photos. scale: of the model; shift: how far its second half is from where it belongs. */
static void make_block(const char *name, double scale, double shift)
{
    char path[128];
    cn_view views[MANY];
    cn_observation seen[MANY];
    cn_camera camera = { 1, CN_LENS_PINHOLE, 640, 480, { 500, 500, 320, 240 } };
    cn_point point = { .xyz = { 0, 0, 500 }, .n_observations = MANY };
    for (uint32_t i = 0; i < MANY; i++) {
        const double x = scale * (i % 3), y = scale * (i / 3 + (i < MANY / 2 ? 0 : shift));
        views[i] = (cn_view){ .name = photos[i].name,
                              .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 },
                              .translation = { -x, -y, 0 } };
        seen[i] = (cn_observation){ i, (float)(320 - x), (float)(240 - y) };
    }
    const cn_scene scene = { &camera, 1, views, MANY, &point, 1, seen, MANY };
    snprintf(path, sizeof path, "%s/%s", folder, name);
    assert_int_equal(cn_scene_write_colmap(&scene, path), CN_OK);
}

/* Few photos agree with GPS. Where two attempts agree with each other, GPS is off, and no more are made; where they do
 * not, poses may be. */
static void test_bad_gps(void **state)
{
    (void)state;
    cn_colmap_result result;
    photo_index.n_photos = photo_index.n_gps = MANY;
    for (int i = 0; i < MANY; i++) {
        photos[i].has_gps = photos[i].has_altitude = true;
        const bool right = i % 3 == 0 || i == 1; /* five of twelve; the others are off by hundreds of metres */
        photos[i].latitude_deg = 46.0 + 1e-3 * (i / 3) + (right ? 0 : 1e-3 * ((i * 7) % MANY));
        photos[i].longitude_deg = 8.0 + 1.436e-3 * (i % 3) - (right ? 0 : 2e-3 * ((i * 5) % 7)); /* as many metres */
    }
    make_block("block", 1, 0);
    make_block("same", 2, 0);
    make_block("apart", 1, 3);
    write_program("*sparse) give block;;\n*sparse-2) give same;;\n*) give block;;");
    assert_int_equal(run(&result), CN_OK);
    assert_int_equal(calls("mapper "), 2);
    assert_non_null(strstr(logged, "two attempts agree"));
    cn_colmap_result_deinit(&result);
    assert_int_equal(cn_folder_remove(work), CN_OK);
    assert_int_equal(cn_folder_make(work), CN_OK);
    options.attempts = 3;
    write_program("*sparse) give block;;\n*sparse-2) give apart;;\n*sparse-3) give same;;");
    assert_int_equal(run(&result), CN_OK);
    assert_int_equal(calls("mapper "), 2 + 3);
    cn_colmap_result_deinit(&result);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_first),       TEST(test_second),      TEST(test_last),          TEST(test_smaller_error),
        TEST(test_more_points), TEST(test_unsupported), TEST(test_doubtful),      TEST(test_core),
        TEST(test_failure),     TEST(test_one_attempt), TEST(test_skewed_lens),   TEST(test_straight_down),
        TEST(test_bad_gps),     TEST(test_connected),   TEST(test_core_of_views),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
