/* Which photo a path of another program means. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "pose/control_file.h"
#include "pose/finder.h"
#include "pose/scene.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { N = 6 };
static char folder[] = "/photos", logged[LOGGED];
static char names[N][32] = { "a.jpg", "cam0/2.jpg", "cam0/3.jpg", "cam1/3.jpg", "day/cam1/4.jpg", "sub/a.jpg" };
static cn_photo photos[N];
static cn_photo_index photo_index = { .folder = folder, .photos = photos, .n_photos = N };
static const cn_context CONTEXT = { .log = log_append, .user = logged };

static int set_up(void **state)
{
    (void)state;
    for (int i = 0; i < N; i++)
        photos[i] = (cn_photo){ .name = names[i], .width = 640, .height = 480, .orientation = 1 };
    logged[0] = '\0';
    return 0;
}

static void test_match(void **state)
{
    (void)state;
    static const struct {
        const char *path;
        int photo;
    } CASES[] = {
        { "a.jpg", 0 },
        { "images/a.jpg", 0 },
        { "/old/place/sub/a.jpg", 5 },
        { "other/a.jpg", 0 },
        { "2.jpg", 1 },
        { "cam0/2.jpg", 1 },
        { "../cam0/2.jpg", 1 },
        { "./../2.jpg", 1 },
        { "/old/place/cam0/2.jpg", 1 },
        { "cam1/2.jpg", -1 }, /* of another camera */
        { "/old/cam1/2.jpg", -1 },
        { "xcam0/2.jpg", -1 },
        { "3.jpg", -1 }, /* of which camera? */
        { "cam1/3.jpg", 3 },
        { "/old/cam1/3.jpg", 3 },
        { "4.jpg", 4 },
        { "cam1/4.jpg", 4 },
        { "night/cam1/4.jpg", -1 },
        { "/old/day/cam1/4.jpg", 4 },
        { "gone.jpg", -1 },
        { "", -1 },
        { "../", -1 },
    };
    cn_photo_finder finder;
    assert_int_equal(cn_photo_finder_init(&finder, &photo_index), CN_OK);
    for (size_t i = 0; i < sizeof CASES / sizeof *CASES; i++) {
        const int64_t found = cn_photo_finder_match(&finder, CASES[i].path);
        if (found != CASES[i].photo) fail_msg("%s is photo %d, not %d", CASES[i].path, (int)found, CASES[i].photo);
    }
    cn_photo_finder_deinit(&finder);
}

/* A collection of one folder, which had another name when the file was written. */
static void test_one_folder(void **state)
{
    (void)state;
    cn_photo two[2] = { { .name = names[1] }, { .name = names[2] } };
    const cn_photo_index index = { .folder = folder, .photos = two, .n_photos = 2 };
    cn_photo_finder finder;
    assert_int_equal(cn_photo_finder_init(&finder, &index), CN_OK);
    assert_int_equal(cn_photo_finder_match(&finder, "images_4/3.jpg"), 1);
    assert_int_equal(cn_photo_finder_match(&finder, "/old/2.jpg"), 0);
    assert_int_equal(cn_photo_finder_match(&finder, "/old/4.jpg"), -1);
    cn_photo_finder_deinit(&finder);
}

#define FRAME(file) "{\"file_path\":\"" file "\",\"transform_matrix\":[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]}"

static void read_frames(const char *text, cn_scene *scene)
{
    char path[] = "/tmp/conurb-finder-XXXXXX";
    const int fd = mkstemp(path);
    assert_true(fd >= 0 && close(fd) == 0);
    assert_int_equal(cn_file_write(path, text, strlen(text)), CN_OK);
    assert_int_equal(cn_scene_read_transforms(&CONTEXT, scene, path, &photo_index), CN_OK);
    unlink(path);
}

/* The pose of a photo that is not there is no pose of another camera's photo of that name. */
static void test_import(void **state)
{
    (void)state;
    cn_scene scene;
    read_frames("{\"fl_x\":500,\"frames\":[" FRAME("cam0/2.jpg") "," FRAME("cam1/2.jpg") "]}", &scene);
    assert_int_equal(scene.n_views, 1);
    assert_string_equal(scene.views[0].name, "cam0/2.jpg");
    assert_non_null(strstr(logged, "photo cam1/2.jpg is not in the collection"));
    cn_scene_deinit(&scene);
}

/* Metashape's labels have no endings. Photos that differ in them alone: JPEG and PNG go before others. */
static void test_endings(void **state)
{
    (void)state;
    cn_photo five[5] = {
        { .name = "b.HEIC" }, { .name = "b2.webp" }, { .name = "c.TIF" }, { .name = "c.jpg" }, { .name = "c.jpg.tif" }
    };
    for (int i = 0; i < 5; i++)
        five[i].width = 640, five[i].height = 480, five[i].orientation = 1;
    const cn_photo_index index = photo_index;
    cn_scene scene;
    photo_index.photos = five;
    photo_index.n_photos = 5;
    read_frames("{\"fl_x\":500,\"frames\":[" FRAME("b") "," FRAME("b2") "," FRAME("old/c") "," FRAME("c.") "]}",
                &scene);
    photo_index = index;
    assert_int_equal(scene.n_views, 3);
    assert_string_equal(scene.views[0].name, "b.HEIC");
    assert_string_equal(scene.views[1].name, "b2.webp");
    assert_string_equal(scene.views[2].name, "c.jpg");
    cn_scene_deinit(&scene);
}

/* All photos were put into one folder for another tool. */
static void test_flattened_import(void **state)
{
    (void)state;
    cn_scene scene;
    read_frames("{\"fl_x\":500,\"frames\":[" FRAME("images/2.jpg") "," FRAME("images/4.jpg") "]}", &scene);
    assert_int_equal(scene.n_views, 2);
    assert_string_equal(scene.views[0].name, "cam0/2.jpg");
    assert_string_equal(scene.views[1].name, "day/cam1/4.jpg");
    assert_non_null(strstr(logged, "the names of the files alone count"));
    cn_scene_deinit(&scene);
}

static void test_control(void **state)
{
    (void)state;
    static const char text[] = "WGS84\n11 48 500 4 5 cam0/2.jpg P1\n11 48 500 6 7 cam1/2.jpg P1\n";
    char path[] = "/tmp/conurb-finder-XXXXXX";
    cn_control control;
    const int fd = mkstemp(path);
    assert_true(fd >= 0 && close(fd) == 0);
    assert_int_equal(cn_file_write(path, text, strlen(text)), CN_OK);
    const cn_control_source source = { &photo_index, path, NULL, false };
    assert_int_equal(cn_control_read(&CONTEXT, &source, &control), CN_OK);
    assert_int_equal(control.n_marks, 1);
    assert_int_equal(control.marks[0].photo, 1);
    assert_non_null(strstr(logged, "photo cam1/2.jpg is not in the collection"));
    cn_control_deinit(&control);
    unlink(path);
}

#define TEST(name) cmocka_unit_test_setup(name, set_up)

int main(void)
{
    const struct CMUnitTest tests[] = { TEST(test_match),   TEST(test_one_folder),       TEST(test_import),
                                        TEST(test_endings), TEST(test_flattened_import), TEST(test_control) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
