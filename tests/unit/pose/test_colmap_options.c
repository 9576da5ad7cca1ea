/* Options of COLMAP that newer ones renamed: a script that knows one of the names stands in for COLMAP. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "conurb/pose.h"
#include "fake_colmap.h"
#include "pose/colmap_options.h"
#include "pose/scene.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { N = 4 };
static char folder[64], program[96];
static cn_photo photos[N];

/* What the help of all programs of COLMAP 4 lists of these options. */
static const char NEW_HELP[] = "  --FeatureExtraction.use_gpu arg (=1)\n"
                               "  --FeatureExtraction.num_threads arg (=-1)\n"
                               "  --FeatureExtraction.max_image_size arg (=-1)\n"
                               "  --SiftExtraction.max_num_features arg (=8192)\n"
                               "  --FeatureMatching.use_gpu arg (=1)\n"
                               "  --FeatureMatching.num_threads arg (=-1)\n"
                               "  --FeatureMatching.guided_matching arg (=0)\n"
                               "  --Mapper.ba_global_frames_ratio arg (=1.1)\n"
                               "  --BundleAdjustmentCeres.max_num_iterations arg (=100)\n";

static int set_up(void **state)
{
    (void)state;
    strcpy(folder, "/tmp/conurb-options-XXXXXX");
    if (!mkdtemp(folder)) return -1;
    snprintf(program, sizeof program, "%s/colmap", folder);
    fake_colmap_photos(photos, N, 640, 480);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    return folder_remove(folder);
}

static void write_help(const char *text)
{
    char path[128];
    snprintf(path, sizeof path, "%s.help", program);
    assert_int_equal(cn_file_write(path, text, strlen(text)), CN_OK);
}

static size_t calls(const char *word)
{
    return file_count(folder, "calls", word);
}

/* Poses by a COLMAP that refuses what `refused`, a pattern of the shell, matches. */
static cn_status pose(const char *refused, cn_pose_report *report)
{
    cn_camera camera = { 1, CN_LENS_PINHOLE, 640, 480, { 500, 500, 320, 240 } };
    cn_view views[N];
    char path[128], work[96], frame[96];
    cn_photo_index index = { .folder = folder, .photos = photos, .n_photos = N };
    cn_pose_options options = cn_pose_options_default();
    for (uint32_t i = 0; i < N; i++)
        views[i] = (cn_view){ .name = photos[i].name, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
    const cn_scene scene = { .cameras = &camera, .n_cameras = 1, .views = views, .n_views = N };
    snprintf(path, sizeof path, "%s/given", folder);
    assert_int_equal(cn_scene_write_colmap(&scene, path), CN_OK);
    snprintf(work, sizeof work, "%s/poses", folder);
    snprintf(frame, sizeof frame, "%s/frame.json", folder);
    fake_colmap_write(program,
                      "#!/bin/sh\necho \"$@\" >> %s/calls\nfor a; do case $a in %s) "
                      "echo \"ERROR: unrecognised option '$a'\"; exit 1;; esac\n"
                      "[ \"$last\" = --output_path ] && out=$a; [ \"$last\" = --database_path ] && : >> $a; last=$a\n"
                      "done\n[ $1 != mapper ] || { mkdir $out/0 && cp %s/* $out/0; }\n",
                      folder, refused, path);
    options.match_with = CN_MATCH_WITH_COLMAP;
    options.colmap = program;
    options.attempts = 1;
    return cn_pose_run(NULL, &index, work, frame, &options, report);
}

static void test_new_names(void **state)
{
    (void)state;
    cn_pose_report report;
    write_help(NEW_HELP);
    assert_int_equal(pose("--SiftExtraction.[!m]*|--SiftExtraction.max_i*|--SiftM*|*_images_ratio", &report), CN_OK);
    cn_pose_report_deinit(&report);
    assert_int_equal(calls("--FeatureExtraction.use_gpu 0 --FeatureExtraction.num_threads"), 1);
    assert_int_equal(calls("--FeatureMatching.use_gpu 0 --FeatureMatching.num_threads"), 1);
    assert_int_equal(calls("--Mapper.ba_global_frames_ratio 1.4"), 1);
    assert_int_equal(calls(" -h"), 0);
}

/* The names stay where the help has both, such as for the time of a change, or has none at all. */
static void test_old_names(void **state)
{
    (void)state;
    cn_pose_report report;
    write_help("  --SiftExtraction.use_gpu arg (=1)\n  --FeatureExtraction.use_gpu arg (=1)\n");
    assert_int_equal(pose("--Feature*|*_frames_ratio", &report), CN_OK);
    cn_pose_report_deinit(&report);
    assert_int_equal(calls("--SiftExtraction.use_gpu 0"), 1);
    assert_int_equal(calls("--SiftMatching.use_gpu 0"), 1);
}

/* Of a COLMAP that has neither name, the check says which. */
static void test_unknown(void **state)
{
    (void)state;
    char help[sizeof NEW_HELP];
    fake_colmap_write(program, "#!/bin/sh\n");
    strcpy(help, NEW_HELP);
    strstr(help, "ba_global_frames_ratio")[3] = 'x';
    write_help(help);
    assert_int_equal(cn_colmap_check_options(NULL, program), CN_ERR_TOOL);
    assert_non_null(strstr(cn_error_message(), "mapper has neither --Mapper.ba_global_images_ratio nor --Mapper.ba_g"));
}

static void test_known(void **state)
{
    (void)state;
    fake_colmap_write(program, "#!/bin/sh\n");
    write_help(NEW_HELP);
    assert_int_equal(cn_colmap_check_options(NULL, program), CN_OK);
    assert_int_equal(cn_colmap_check_options(NULL, "/nonexistent"), CN_OK);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = { TEST(test_new_names), TEST(test_old_names), TEST(test_unknown),
                                        TEST(test_known) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
