/* COLMAP's part played by a shell script: what it is asked, how it fails, how a rerun resumes. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "base/json.h"
#include "bridge/oiio.h"
#include "conurb/pose.h"
#include "fake_colmap.h"
#include "math/linalg.h"
#include "pose/colmap.h"
#include "pose/scene.h"

#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

enum { N = 4 };
static char folder[64], program[96], work[96], frame_path[96], model[96], logged[LOGGED];
static cn_photo photos[N];
static cn_photo_index photo_index;
static int n_progress;

static void count(void *user, const cn_progress_report *report)
{
    (void)user;
    assert_string_equal(report->stage, "poses");
    assert_true(report->done <= report->total);
    n_progress++;
}

static int stop;
static const cn_context CONTEXT = { .log = log_append, .user = logged, .progress = count, .stop = &stop };

/* A model of photos 0 to 2, and one of 0 alone, for the script to hand out. */
static void make_models(void)
{
    cn_camera camera = { 1, CN_LENS_PINHOLE, 640, 480, { 500, 500, 320, 240 } };
    cn_view views[3];
    char path[128];
    for (int i = 0; i < 3; i++)
        views[i] =
            (cn_view){ .name = photos[i].name, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 }, .translation = { i, 0, 0 } };
    cn_scene scene = { .cameras = &camera, .n_cameras = 1, .views = views, .n_views = 1 };
    snprintf(path, sizeof path, "%s/0", model);
    assert_int_equal(cn_scene_write_colmap(&scene, path), CN_OK);
    scene.n_views = 3;
    snprintf(path, sizeof path, "%s/1", model);
    assert_int_equal(cn_scene_write_colmap(&scene, path), CN_OK);
}

static void write_program(const char *body)
{
    fake_colmap_write(program,
                      "#!/bin/sh\necho \"$@\" >> %s/calls\nout=\nfor a; do [ \"$last\" = --output_path ] && out=$a; "
                      "[ \"$last\" = --database_path ] && : >> $a; last=$a; done\n%s\n",
                      folder, body);
}

static void write_good_program(void)
{
    char body[512];
    snprintf(body, sizeof body,
             "case $1 in\nfeature_extractor) echo 'Processed file [1/4]'; echo '  Name:  a.jpg';"
             " echo '  ERROR: Failed to read image file format.'; echo 'Processed file [4/4]';;\n"
             "exhaustive_matcher) echo 'Matching block [1/1, 1/1] in 0.1s';;\n"
             "mapper) echo 'Registering image #2 (3)'; cp -r %s/* $out;;\nesac",
             model);
    write_program(body);
}

static int set_up(void **state)
{
    (void)state;
    static char images[96];
    strcpy(folder, "/tmp/conurb-run-XXXXXX");
    if (!mkdtemp(folder)) return -1;
    snprintf(program, sizeof program, "%s/colmap", folder);
    snprintf(work, sizeof work, "%s/poses", folder);
    snprintf(frame_path, sizeof frame_path, "%s/frame.json", folder);
    snprintf(model, sizeof model, "%s/given", folder);
    snprintf(images, sizeof images, "%s/images", folder);
    fake_colmap_photos(photos, N, 640, 480);
    photo_index = (cn_photo_index){ .folder = images, .photos = photos, .n_photos = N };
    logged[0] = '\0';
    stop = 0;
    n_progress = 0;
    make_models();
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    return folder_remove(folder);
}

static cn_status run(cn_pose_report *report)
{
    cn_pose_options options = cn_pose_options_default();
    options.match_with = CN_MATCH_WITH_COLMAP;
    options.colmap = program;
    options.attempts = 1; /* test_ladder has several */
    cn_status status = cn_pose_run(&CONTEXT, &photo_index, work, frame_path, &options, report);
    if (status != CN_OK) assert_null(report->unregistered);
    return status;
}

static size_t calls(const char *word)
{
    return file_count(folder, "calls", word);
}

static bool is_finished(void)
{
    char path[128];
    snprintf(path, sizeof path, "%s/poses.json", work);
    return cn_file_exists(path);
}

static void test_largest_model(void **state)
{
    (void)state;
    cn_pose_report report;
    cn_scene scene;
    write_good_program();
    assert_int_equal(run(&report), CN_OK);
    assert_int_equal(report.n_models, 2);
    assert_int_equal(report.n_registered, 3);
    assert_int_equal(report.n_unregistered, 1);
    assert_string_equal(report.unregistered[0], "d.jpg");
    cn_pose_report_deinit(&report);
    assert_non_null(strstr(logged, "d.jpg"));
    assert_non_null(strstr(logged, "2 separate parts"));
    assert_non_null(strstr(logged, "cannot read photo a.jpg"));
    assert_non_null(strstr(logged, "no georeference"));
    assert_true(n_progress >= 3);
    assert_true(is_finished());
    assert_int_equal(calls("--ImageReader.single_camera 1"), 1); /* all alike: one lens */
    assert_int_equal(cn_pose_load(&CONTEXT, work, &photo_index, &scene), CN_OK);
    assert_int_equal(scene.n_views, 3);
    assert_int_equal(scene.views[2].photo, 2);
    cn_scene_deinit(&scene);
    photo_index.n_photos = 2; /* a photo gone since */
    assert_int_equal(cn_pose_load(&CONTEXT, work, &photo_index, &scene), CN_OK);
    assert_int_equal(scene.n_views, 2);
    cn_scene_deinit(&scene);
}

static void test_resumes(void **state)
{
    (void)state;
    cn_pose_report report;
    write_program("[ $1 = feature_extractor ] && exit 0\necho 'ERROR: no luck'\nexit 1");
    assert_int_equal(run(&report), CN_ERR_TOOL);
    assert_non_null(strstr(cn_error_message(), "no luck"));
    assert_non_null(strstr(cn_error_message(), "matches"));
    assert_false(is_finished());
    write_good_program();
    assert_int_equal(run(&report), CN_OK);
    cn_pose_report_deinit(&report);
    assert_int_equal(calls("feature_extractor"), 1);
    assert_int_equal(calls("exhaustive_matcher"), 2);
    assert_int_equal(run(&report), CN_OK);
    cn_pose_report_deinit(&report);
    assert_int_equal(calls("mapper"), 1);
    photos[1].hash = 77; /* another photo under the same name: all again */
    assert_int_equal(run(&report), CN_OK);
    cn_pose_report_deinit(&report);
    assert_int_equal(calls("feature_extractor"), 2);
    assert_int_equal(calls("mapper"), 2);
}

static void test_failures(void **state)
{
    (void)state;
    cn_pose_report report;
    assert_int_equal(run(&report), CN_ERR_TOOL); /* no program yet */
    assert_non_null(strstr(cn_error_message(), "apt-get install colmap"));
    write_program("kill -9 $$");
    assert_int_equal(run(&report), CN_ERR_TOOL);
    assert_non_null(strstr(cn_error_message(), "signal 9"));
    write_program("exit 0");
    assert_int_equal(run(&report), CN_ERR_DATA); /* a mapper that maps nothing */
    assert_non_null(strstr(cn_error_message(), "overlap"));
    assert_false(is_finished());
    photo_index.n_photos = 1;
    assert_int_equal(run(&report), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "at least two"));
    photo_index.n_photos = 0;
    assert_int_equal(run(&report), CN_ERR_DATA);
}

static void stop_now(void *user, const cn_progress_report *report)
{
    (void)user;
    (void)report;
    stop = 1;
}

static void test_stops(void **state)
{
    (void)state;
    const cn_context ctx = { .progress = stop_now, .stop = &stop };
    cn_pose_options options = cn_pose_options_default();
    options.match_with = CN_MATCH_WITH_COLMAP;
    cn_pose_report report;
    options.colmap = program;
    write_program("echo 'Processed file [1/4]'\nexec sleep 600");
    assert_int_equal(cn_pose_run(&ctx, &photo_index, work, frame_path, &options, &report), CN_ERR_INTERRUPTED);
    assert_false(is_finished());
}

enum { MANY = 40, KEPT = 150 };

/* A collection along a street, of which each photo has others in reach. */
static void make_street(cn_photo *street, char (*names)[16])
{
    for (int i = 0; i < MANY; i++) {
        snprintf(names[i], sizeof names[i], "%02d.jpg", i);
        street[i] = photos[0];
        street[i].name = names[i];
        street[i].hash = (uint64_t)i;
        street[i].has_gps = true;
        street[i].latitude_deg = 47 + 1e-4 * i;
        street[i].longitude_deg = 8;
    }
    photo_index.photos = street;
    photo_index.n_photos = photo_index.n_gps = MANY;
}

/* A COLMAP that keeps the pairs of its list when it is through with all of them, as the true one does, and while there
 * is a file `hang`, is not through when it comes to pair KEPT. */
static void write_slow_program(void)
{
    char body[1024];
    snprintf(body, sizeof body,
             "list=\nfor a; do [ \"$b\" = --match_list_path ] && list=$a; b=$a; done\n"
             "db=%s/poses/database.db\ncase $1 in\n"
             "matches_importer) n=$(($(wc -l <$db) + $(wc -l <$list)))\n"
             "  [ -e %s/hang ] && [ $n -gt %d ] && echo $$ >%s/pid.new && mv %s/pid.new %s/pid && exec sleep 1000\n"
             "  cat $list >>$db; echo 'Matching block [1/1] in 0.1s';;\n"
             "database_cleaner) : >$db;;\n"
             "mapper) cp -r %s/* $out;;\nesac",
             folder, folder, KEPT, folder, folder, folder, model);
    write_program(body);
}

static size_t lines_of(const char *name)
{
    char path[160], *text;
    size_t size, n = 0;
    snprintf(path, sizeof path, "%s/%s", folder, name);
    assert_int_equal(cn_file_read(path, 0, &text, &size), CN_OK);
    for (size_t i = 0; i < size; i++)
        n += text[i] == '\n';
    free(text);
    return n;
}

/* Gone, or dead with nobody who asked how it ended. */
static bool gone(pid_t pid)
{
    char path[64], text[512] = "";
    snprintf(path, sizeof path, "/proc/%ld/stat", (long)pid);
    FILE *stream = fopen(path, "r");
    if (!stream) return true;
    const bool read = fgets(text, sizeof text, stream) != NULL;
    fclose(stream);
    return !read || strstr(text, ") Z ");
}

/* Runs in a process of its own, which is killed when COLMAP hangs. Returns COLMAP's number. */
static pid_t killed_run(void)
{
    char hang[96], path[96], *text;
    size_t size;
    snprintf(hang, sizeof hang, "%s/hang", folder);
    snprintf(path, sizeof path, "%s/pid", folder);
    assert_int_equal(cn_file_write(hang, "", 0), CN_OK);
    const pid_t runner = fork();
    assert_true(runner >= 0);
    if (runner == 0) {
        cn_pose_report report;
        _exit((int)run(&report));
    }
    while (!cn_file_exists(path)) {
        assert_int_equal(waitpid(runner, NULL, WNOHANG), 0);
        poll(NULL, 0, 5);
    }
    assert_int_equal(kill(runner, SIGKILL), 0);
    assert_int_equal(waitpid(runner, NULL, 0), runner);
    assert_int_equal(cn_file_read(path, 0, &text, &size), CN_OK);
    const pid_t colmap = (pid_t)strtol(text, NULL, 10);
    free(text);
    assert_int_equal(unlink(hang), 0);
    return colmap;
}

/* kill -9 in matching: what COLMAP had kept is there for the next run, which finds no COLMAP of the run before. */
static void test_matches_outlive_a_kill(void **state)
{
    (void)state;
    static cn_photo street[MANY];
    static char names[MANY][16];
    cn_pose_report report;
    make_street(street, names);
    write_slow_program();
    const pid_t colmap = killed_run();
    const size_t kept = lines_of("poses/database.db");
    assert_true(kept > 0 && kept <= KEPT);
    (void)run(&report); /* its model is of other photos */
    assert_true(gone(colmap));
    assert_int_equal(calls("feature_extractor"), 1);
    assert_int_equal(calls("database_cleaner"), 0);
    assert_true(lines_of("poses/database.db") > KEPT);
    cn_pose_report_deinit(&report);
}

/* What was kept for another way to match does not stay among the matches. */
static void test_matches_of_other_work(void **state)
{
    (void)state;
    static cn_photo street[MANY];
    static char names[MANY][16];
    cn_pose_report report;
    make_street(street, names);
    write_slow_program();
    (void)killed_run();
    assert_true(lines_of("poses/database.db") > 0);
    for (int i = 0; i < MANY; i++)
        street[i].has_gps = false;
    photo_index.n_gps = 0;
    (void)run(&report);
    assert_int_equal(calls("feature_extractor"), 1);
    assert_int_equal(calls("database_cleaner --type matches"), 1);
    assert_int_equal(calls("exhaustive_matcher"), 1);
    assert_int_equal(lines_of("poses/database.db"), 0);
    cn_pose_report_deinit(&report);
}

/* COLMAP says nothing while it is busy: reports come all the same. */
static int n_silent;

static void stop_after_silence(void *user, const cn_progress_report *report)
{
    (void)user;
    assert_true(report->done >= 0 && report->done <= report->total);
    n_silent += strcmp(report->item, "features") == 0 && report->done == 1;
    if (n_silent == 3) stop = 1;
}

static void test_no_silence(void **state)
{
    (void)state;
    const cn_context ctx = { .progress = stop_after_silence, .stop = &stop };
    cn_pose_options options = cn_pose_options_default();
    options.match_with = CN_MATCH_WITH_COLMAP;
    cn_pose_report report;
    options.colmap = program;
    n_silent = 0;
    write_program("sleep 1\necho 'Processed file [1/4]'\nexec sleep 600");
    assert_int_equal(cn_pose_run(&ctx, &photo_index, work, frame_path, &options, &report), CN_ERR_INTERRUPTED);
    assert_int_equal(n_silent, 3);
}

static void test_spaces_in_names(void **state)
{
    (void)state;
    cn_pose_report report;
    cn_scene scene;
    char first[] = "a b.jpg", path[160];
    write_program("");
    photos[0].name = first;
    cn_camera camera = { 1, CN_LENS_PINHOLE, 640, 480, { 500, 500, 320, 240 } };
    cn_view view = { .name = (char[]){ "00000000.jpg" }, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
    scene = (cn_scene){ .cameras = &camera, .n_cameras = 1, .views = &view, .n_views = 1 };
    snprintf(path, sizeof path, "%s/linked", folder);
    assert_int_equal(cn_scene_write_colmap(&scene, path), CN_OK);
    snprintf(path, sizeof path, "[ $1 = mapper ] && cp -r %s/linked $out/0\nexit 0", folder);
    write_program(path);
    assert_int_equal(run(&report), CN_OK);
    assert_int_equal(report.n_registered, 1);
    cn_pose_report_deinit(&report);
    assert_int_equal(cn_pose_load(NULL, work, &photo_index, &scene), CN_OK);
    assert_string_equal(scene.views[0].name, "a b.jpg");
    cn_scene_deinit(&scene);
}

/* A TIFF of 16 bits, stored lying, to be shown upright. */
static void test_photos_that_colmap_does_not_read(void **state)
{
    (void)state;
    enum { W = 6, H = 4 };
    cn_pose_report report;
    char name[] = "b.tif", path[192], copied[224];
    float rgb[3 * W * H], *rgba;
    uint32_t width, height;
    for (int i = 0; i < 3 * W * H; i++)
        rgb[i] = i < 3 * W ? 0.9f : 0.2f;
    snprintf(path, sizeof path, "%s/images", folder);
    assert_int_equal(cn_folder_make(path), CN_OK);
    snprintf(path, sizeof path, "%s/images/b.tif", folder);
    const double turned = 6;
    const cn_oiio_attribute about[] = { { "Orientation", NULL, &turned, 1 }, { NULL, NULL, NULL, 0 } };
    assert_int_equal(cn_oiio_write_tiff(path, rgb, W, H, about), CN_OK);
    photos[1].name = name;
    photos[1].deep = true;
    photos[1].orientation = 6;
    photos[1].focal_35mm = 28;
    photos[1].hash = 0xabc;
    write_program("exit 3");
    assert_int_equal(run(&report), CN_ERR_TOOL);
    snprintf(path, sizeof path, "%s/links/00000000.jpg", work);
    struct stat st;
    assert_int_equal(lstat(path, &st), 0);
    assert_true(S_ISLNK(st.st_mode));
    snprintf(copied, sizeof copied, "%s/links/00000001-0000000000000abc.jpg", work);
    cn_oiio_info info;
    assert_int_equal(cn_oiio_read_info(copied, &info), CN_OK);
    assert_false(info.is_deep);
    assert_int_equal(info.exif.focal_35mm, 28);
    assert_int_equal(cn_oiio_read_rgba(copied, &rgba, &width, &height), CN_OK);
    assert_int_equal(width, W);
    assert_int_equal(height, H);
    assert_float_equal(rgba[4], 0.9, 0.05);
    assert_float_equal(rgba[4 * (W * H - 1)], 0.2, 0.05);
    free(rgba);
    /* A copy is made once. */
    assert_int_equal(cn_file_write(copied, "kept", 4), CN_OK);
    assert_int_equal(run(&report), CN_ERR_TOOL);
    assert_int_equal(stat(copied, &st), 0);
    assert_int_equal(st.st_size, 4);
}

static void test_imports(void **state)
{
    (void)state;
    cn_pose_options options = cn_pose_options_default();
    options.match_with = CN_MATCH_WITH_COLMAP;
    cn_pose_report report;
    options.import = model;
    assert_int_equal(cn_pose_run(&CONTEXT, &photo_index, work, frame_path, &options, &report), CN_OK);
    assert_int_equal(report.n_registered, 3);
    assert_int_equal(report.n_models, 2);
    cn_pose_report_deinit(&report);
    cn_scene scene;
    assert_int_equal(cn_pose_load(NULL, work, &photo_index, &scene), CN_OK);
    /* Without GPS the poses are only turned and moved, as the frame says. */
    cn_frame frame;
    double back[9], move[3];
    assert_int_equal(cn_frame_load(&frame, frame_path), CN_OK);
    assert_true(!frame.georeferenced && frame.scale == 1);
    cn_mat3_transpose(frame.rotation, back);
    cn_mat3_vec(back, frame.translation, move);
    for (int k = 0; k < 3; k++)
        move[k] = -move[k];
    cn_scene_transform(&scene, 1, back, move);
    assert_true(fabs(scene.views[2].translation[0] - 2.0) < 1e-9);
    cn_scene_deinit(&scene);
    options.import = "/nonexistent";
    assert_int_equal(cn_pose_run(&CONTEXT, &photo_index, work, frame_path, &options, &report), CN_ERR_IO);
    assert_true(is_finished()); /* what was there before is whole */
    for (int i = 0; i < 3; i++)
        photos[i].name[0] = 'x';
    options.import = model;
    assert_int_equal(cn_pose_run(&CONTEXT, &photo_index, work, frame_path, &options, &report), CN_ERR_DATA);
    assert_true(is_finished());
}

/* A model whose lens has no inverse over the picture: the line names the model, the camera and a photo. */
static void test_imports_no_such_lens(void **state)
{
    (void)state;
    static const double K1[] = { -5, 50 };
    cn_pose_options options = cn_pose_options_default();
    options.match_with = CN_MATCH_WITH_COLMAP;
    cn_pose_report report;
    char path[160];
    snprintf(path, sizeof path, "%s/bad", folder);
    options.import = path;
    for (int i = 0; i < 2; i++) {
        cn_camera camera = { 7, CN_LENS_SIMPLE_RADIAL, 640, 480, { 500, 320, 240, K1[i] } };
        cn_view view = { .name = photos[0].name, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
        const cn_scene scene = { .cameras = &camera, .n_cameras = 1, .views = &view, .n_views = 1 };
        assert_int_equal(cn_scene_write_colmap(&scene, path), CN_OK);
        assert_int_equal(cn_pose_run(&CONTEXT, &photo_index, work, frame_path, &options, &report), CN_ERR_FORMAT);
        assert_non_null(strstr(cn_error_message(), path));
        assert_non_null(strstr(cn_error_message(), "of photo a.jpg: the distortion"));
        assert_false(is_finished());
    }
}

/* A file may have no more than 10 bytes: as good as a full disk. */
static void test_full_disk(void **state)
{
    (void)state;
    cn_pose_options options = cn_pose_options_default();
    options.match_with = CN_MATCH_WITH_COLMAP;
    cn_pose_report report;
    cn_scene scene;
    struct rlimit was, tight;
    options.import = model;
    assert_int_equal(cn_pose_run(&CONTEXT, &photo_index, work, frame_path, &options, &report), CN_OK);
    cn_pose_report_deinit(&report);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &was), 0);
    tight = was;
    tight.rlim_cur = 10;
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &tight), 0);
    cn_status status = cn_pose_run(&CONTEXT, &photo_index, work, frame_path, &options, &report);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &was), 0);
    assert_int_equal(status, CN_ERR_IO);
    assert_true(is_finished());
    assert_int_equal(cn_pose_load(NULL, work, &photo_index, &scene), CN_OK);
    assert_int_equal(scene.n_views, 3);
    cn_scene_deinit(&scene);
}

static void test_newer_version(void **state)
{
    (void)state;
    cn_scene scene;
    char path[128];
    snprintf(path, sizeof path, "%s/poses.json", work);
    assert_int_equal(cn_folder_make(work), CN_OK);
    assert_int_equal(cn_file_write(path, "{\"version\": 2}", 14), CN_OK);
    assert_int_equal(cn_pose_load(NULL, work, &photo_index, &scene), CN_ERR_VERSION);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_largest_model),
        TEST(test_resumes),
        TEST(test_failures),
        TEST(test_stops),
        TEST(test_spaces_in_names),
        TEST(test_photos_that_colmap_does_not_read),
        TEST(test_imports),
        TEST(test_imports_no_such_lens),
        TEST(test_matches_outlive_a_kill),
        TEST(test_matches_of_other_work),
        TEST(test_no_silence),
        TEST(test_full_disk),
        TEST(test_newer_version),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
