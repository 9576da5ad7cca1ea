/* Poses that the photos' GPS contradicts are found anew: imported ones, and those of COLMAP's first attempt. A shell
 * script plays COLMAP. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../bridge/colmap_database.h"
#include "../common.h"
#include "base/file.h"
#include "conurb/pose.h"
#include "fake_colmap.h"
#include "pose/scene.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { N = 16, HALF = N / 2 };
#define STEP_M 10.0
#define METRES_PER_DEGREE 111320.0

static char folder[64], program[96], work[96], frame_file[96], import[96], logged[LOGGED];
static cn_photo photos[N];
static cn_photo_index photo_index;
static cn_pose_options options;

static const cn_context CONTEXT = { .log = log_append, .user = logged };

/* Photo i stands i steps along a street to the north, which bends a little to the east. */
static void place(int i, double at[2])
{
    at[0] = 0.02 * STEP_M * i * i;
    at[1] = STEP_M * i;
}

/* FOLDER/NAME: a model of the photos. From photo `broken` on, the street goes on at a right angle. */
static void make_model(const char *name, int broken)
{
    char path[128];
    cn_view views[N];
    cn_observation seen[N];
    cn_camera camera = { 1, CN_LENS_PINHOLE, 640, 480, { 500, 500, 320, 240 } };
    for (int i = 0; i < N; i++) {
        double at[2], corner[2];
        place(i, at);
        place(broken, corner);
        /* x east, y down, z north, as the cameras look */
        double centre[3] = { at[0], 0.01 * (i % 3), at[1] };
        if (i > broken) {
            centre[0] = corner[0] + (at[1] - corner[1]);
            centre[2] = corner[1] - (at[0] - corner[0]);
        }
        views[i] = (cn_view){ .name = photos[i].name, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
        for (int k = 0; k < 3; k++)
            views[i].translation[k] = -0.1 * centre[k];
        seen[i] = (cn_observation){ (uint32_t)i, 320, 240 };
    }
    cn_point point = { .xyz = { 0, 0, 100 }, .n_observations = N };
    const cn_scene scene = { &camera, 1, views, N, &point, 1, seen, N };
    snprintf(path, sizeof path, "%s/%s", folder, name);
    assert_int_equal(cn_scene_write_colmap(&scene, path), CN_OK);
}

static void write_program(const char *mapper)
{
    fake_colmap_write(program,
                      "#!/bin/sh\necho \"$@\" >> %s/calls\nout=\nfor a; do [ \"$last\" = --output_path ] && out=$a; "
                      "[ \"$last\" = --database_path ] && [ ! -e $a ] && cp %s/made.db $a; last=$a; done\n"
                      "give() { mkdir -p $out/0; cp %s/$1/* $out/0; }\n"
                      "case $1 in\nmapper) %s;;\nesac\n",
                      folder, folder, folder, mapper);
}

static int set_up(void **state)
{
    (void)state;
    static char images[96];
    char made[96];
    strcpy(folder, "/tmp/conurb-check-XXXXXX");
    if (!mkdtemp(folder)) return -1;
    snprintf(program, sizeof program, "%s/colmap", folder);
    snprintf(work, sizeof work, "%s/poses", folder);
    snprintf(frame_file, sizeof frame_file, "%s/frame.json", folder);
    snprintf(images, sizeof images, "%s/images", folder);
    fake_colmap_photos(photos, N, 640, 480);
    for (int i = 0; i < N; i++) {
        double at[2];
        place(i, at);
        photos[i].has_gps = photos[i].has_altitude = true;
        photos[i].altitude_m = 50.0 - 0.01 * (i % 3);
        photos[i].latitude_deg = at[1] / METRES_PER_DEGREE;
        photos[i].longitude_deg = 10.0 + at[0] / METRES_PER_DEGREE;
    }
    photo_index = (cn_photo_index){ .folder = images, .photos = photos, .n_photos = N, .n_gps = N };
    options = cn_pose_options_default();
    options.match_with = CN_MATCH_WITH_COLMAP;
    options.colmap = program;
    options.import = import;
    options.attempts = 1;
    snprintf(import, sizeof import, "%s/broken", folder);
    logged[0] = '\0';
    snprintf(made, sizeof made, "%s/made.db", folder);
    colmap_database_make(made);
    make_model("whole", N);
    make_model("broken", HALF);
    make_model("broken-too", HALF + 1);
    write_program("give whole");
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    return folder_remove(folder);
}

/* report.json has this text. */
static bool reported(const char *says)
{
    return file_count(work, "report.json", says) > 0;
}

static bool called(void)
{
    char path[128];
    snprintf(path, sizeof path, "%s/calls", folder);
    return cn_file_exists(path);
}

/* Runs the stage; the number of photos that then agree with their GPS. */
static uint32_t run(void)
{
    cn_pose_report report;
    cn_frame frame;
    assert_int_equal(cn_pose_run(&CONTEXT, &photo_index, work, frame_file, &options, &report), CN_OK);
    assert_int_equal(report.n_registered, N);
    cn_pose_report_deinit(&report);
    assert_int_equal(cn_frame_load(&frame, frame_file), CN_OK);
    assert_int_equal(frame.n_gps, N);
    return frame.n_inliers;
}

static void test_broken_import(void **state)
{
    (void)state;
    assert_int_equal(run(), N);
    assert_true(called());
    assert_non_null(strstr(logged, "these poses bend, or parts of them are joined wrongly"));
    assert_non_null(strstr(logged, "the poses found anew are used: 16 of 16 photos agree with their GPS"));
    assert_true(reported("\"outcome\": \"replaced\"") && reported("\"agree_found_anew\": 16"));
}

static void test_good_import(void **state)
{
    (void)state;
    snprintf(import, sizeof import, "%s/whole", folder);
    assert_int_equal(run(), N);
    assert_false(called());
    assert_null(strstr(logged, "joined wrongly"));
    assert_true(reported("\"outcome\": \"agrees\""));
}

static void test_off(void **state)
{
    (void)state;
    options.check_import = CN_OFF;
    assert_true(run() < 0.6 * N);
    assert_false(called());
    assert_true(reported("\"outcome\": \"unchecked\""));
}

/* What is found anew is no better: the import stays. */
static void test_no_better(void **state)
{
    (void)state;
    write_program("give broken-too");
    const uint32_t n = run();
    assert_true(n < 0.6 * N);
    assert_true(called());
    assert_non_null(strstr(logged, "the imported poses are kept: found anew, 16 photos have a pose"));
    assert_true(reported("\"outcome\": \"kept\"") && !reported("\"attempt\""));
}

static void test_no_colmap(void **state)
{
    (void)state;
    options.colmap = "/nonexistent/colmap";
    assert_true(run() < 0.6 * N);
    assert_non_null(strstr(logged, "the imported poses are kept, because no others were found"));
    assert_true(reported("\"outcome\": \"doubtful\""));
}

/* Wrong GPS of few photos says nothing about poses. */
static void test_few_gps(void **state)
{
    (void)state;
    cn_pose_report report;
    for (int i = 0; i < N; i++)
        photos[i].has_gps = i >= HALF - 3 && i <= HALF + 3;
    assert_int_equal(cn_pose_run(&CONTEXT, &photo_index, work, frame_file, &options, &report), CN_OK);
    cn_pose_report_deinit(&report);
    assert_false(called());
}

/* All photos with a pose are not enough where most disagree with their GPS. */
static void test_next_attempt(void **state)
{
    (void)state;
    options.import = NULL;
    options.attempts = 2;
    write_program("case $out in *sparse) give broken;; *) give whole;; esac");
    assert_int_equal(run(), N);
    assert_non_null(strstr(logged, "attempt 2 (a start from forward motion and small angles): 16 of 16 photos"));
    assert_non_null(strstr(logged, "px, 16 of 16 agree with their GPS"));
    assert_true(reported("\"attempt\": 2"));
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_broken_import), TEST(test_good_import), TEST(test_off),          TEST(test_no_better),
        TEST(test_no_colmap),     TEST(test_few_gps),     TEST(test_next_attempt),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
