#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "conurb/pose.h"
#include "math/linalg.h"
#include "pose/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const char *const FILES[] = { "cameras", "images", "points3D" };
static char folder[64];

static int make_folder(void **state)
{
    (void)state;
    strcpy(folder, "/tmp/conurb-model-XXXXXX");
    return mkdtemp(folder) ? 0 : -1;
}

static int remove_folder(void **state)
{
    (void)state;
    static const char *const MORE[] = { "rigs.bin", "frames.bin" };
    char path[128];
    for (int i = 0; i < 6; i++) {
        snprintf(path, sizeof path, "%s/%s.%s", folder, FILES[i / 2], i % 2 ? "txt" : "bin");
        unlink(path);
    }
    for (int i = 0; i < 2; i++) {
        snprintf(path, sizeof path, "%s/%s", folder, MORE[i]);
        unlink(path);
    }
    return rmdir(folder);
}

static void put(const char *name, const void *data, size_t size)
{
    char *path = cn_path_join(folder, name);
    assert_int_equal(cn_file_write(path, data, size), CN_OK);
    free(path);
}

static void take(const char *name, char **data, size_t *size)
{
    char *path = cn_path_join(folder, name);
    assert_int_equal(cn_file_read(path, 0, data, size), CN_OK);
    free(path);
}

static const char CAMERAS[] = "# Camera list\n# Number of cameras: 2\n"
                              "7 SIMPLE_RADIAL 640 480 500.5 320 240 -0.01\r\n"
                              "3 OPENCV 800 600 700 701 400 300 0.1 -0.2 0.003 -0.004\n";
static const char IMAGES[] = "# Number of images: 3, mean observations per image: 1\n"
                             "12 1 0 0 0 0.5 -1 2 3 b name.jpg\n"
                             "10.5 20.25 -1 30 40 5\n"
                             "4 0.5 0.5 0.5 0.5 1 2 3 7 c/a.jpg\n"
                             "1.5 2.5 5\n"
                             "9 0 1 0 0 0 0 0 7 a.jpg\n"
                             "\n";
static const char POINTS[] = "# Number of points: 1, mean track length: 2\n"
                             "5 1 2 3 10 20 30 0.75 12 1 4 0\n";

static void put_text_model(void)
{
    put("cameras.txt", CAMERAS, sizeof CAMERAS - 1);
    put("images.txt", IMAGES, sizeof IMAGES - 1);
    put("points3D.txt", POINTS, sizeof POINTS - 1);
}

static void check_scene(const cn_scene *scene)
{
    assert_int_equal(scene->n_cameras, 2);
    assert_int_equal(scene->n_views, 3);
    assert_string_equal(scene->views[0].name, "a.jpg");
    assert_string_equal(scene->views[1].name, "b name.jpg");
    assert_string_equal(scene->views[2].name, "c/a.jpg");
    const cn_camera *camera = &scene->cameras[scene->views[1].camera];
    assert_int_equal(camera->lens, CN_LENS_OPENCV);
    assert_true(camera->params[7] == -0.004 && camera->width == 800);
    assert_int_equal(scene->cameras[scene->views[0].camera].lens, CN_LENS_SIMPLE_RADIAL);
    assert_true(fabs(scene->views[0].rotation[8] + 1.0) < 1e-15); /* half a turn about x */
    assert_true(fabs(scene->views[2].rotation[2] - 1.0) < 1e-15); /* a third of a turn about the diagonal */
    double centre[3];
    cn_view_centre(&scene->views[1], centre);
    assert_true(centre[0] == -0.5 && centre[1] == 1.0 && centre[2] == -2.0);
    assert_int_equal(scene->n_points, 1);
    assert_true(scene->points[0].xyz[2] == 3.0 && scene->points[0].rgb[1] == 20 && scene->points[0].error_px == 0.75f);
    assert_int_equal(scene->n_observations, 2);
    assert_int_equal(scene->points[0].n_observations, 2);
    assert_int_equal(scene->observations[0].view, 1);
    assert_true(scene->observations[0].x_px == 30.0f && scene->observations[0].y_px == 40.0f);
    assert_int_equal(scene->observations[1].view, 2);
    assert_true(scene->observations[1].x_px == 1.5f);
}

static void test_both_formats(void **state)
{
    (void)state;
    cn_scene text, binary;
    put_text_model();
    assert_int_equal(cn_scene_read_colmap(&text, folder), CN_OK);
    check_scene(&text);
    assert_int_equal(cn_scene_write_colmap(&text, folder), CN_OK);
    put("rigs.bin", "newer", 5); /* COLMAP 3.12 and later: the poses are still in images.bin */
    put("frames.bin", "newer", 5);
    assert_int_equal(cn_scene_read_colmap(&binary, folder), CN_OK);
    check_scene(&binary);
    assert_int_equal(cn_model_photos(folder), 3);
    for (uint32_t i = 0; i < 3; i++) {
        for (int k = 0; k < 9; k++)
            assert_true(fabs(text.views[i].rotation[k] - binary.views[i].rotation[k]) < 1e-15);
        assert_memory_equal(text.views[i].translation, binary.views[i].translation, 24);
    }
    cn_scene_deinit(&text);
    cn_scene_deinit(&binary);
}

static cn_status read_now(void)
{
    cn_scene scene;
    cn_status status = cn_scene_read_colmap(&scene, folder);
    if (status == CN_OK)
        cn_scene_deinit(&scene);
    else
        assert_null(scene.views);
    return status;
}

static void put_binary_model(void)
{
    cn_scene scene;
    put_text_model();
    assert_int_equal(cn_scene_read_colmap(&scene, folder), CN_OK);
    assert_int_equal(cn_scene_write_colmap(&scene, folder), CN_OK);
    cn_scene_deinit(&scene);
}

static void test_truncated_binary(void **state)
{
    (void)state;
    put_binary_model();
    for (int i = 0; i < 3; i++) {
        char name[32], *data;
        size_t size;
        snprintf(name, sizeof name, "%s.bin", FILES[i]);
        take(name, &data, &size);
        for (size_t cut = 0; cut < size; cut++) {
            put(name, data, cut);
            assert_int_equal(read_now(), CN_ERR_FORMAT);
            assert_non_null(strstr(cn_error_message(), name));
        }
        put(name, data, size);
        free(data);
    }
    assert_int_equal(read_now(), CN_OK);
}

/* Text may be cut within a number and still be text: it must not crash, and a cut line or item is told. */
static void test_truncated_text(void **state)
{
    (void)state;
    put_text_model();
    for (int i = 0; i < 3; i++) {
        char name[32], *data;
        size_t size;
        snprintf(name, sizeof name, "%s.txt", FILES[i]);
        take(name, &data, &size);
        for (size_t cut = 0; cut < size; cut++) {
            put(name, data, cut);
            cn_status status = read_now();
            assert_true(status == CN_OK || status == CN_ERR_FORMAT);
        }
        put(name, data, size / 2);
        assert_int_equal(read_now(), CN_ERR_FORMAT);
        put(name, data, size);
        free(data);
    }
    assert_int_equal(read_now(), CN_OK);
}

/* Every byte of every file set to 0xff in turn: counts become monstrous, numbers become NaN, ids get lost. */
static void test_flipped_bytes(void **state)
{
    (void)state;
    put_binary_model();
    for (int i = 0; i < 3; i++) {
        char name[32], *data;
        size_t size;
        snprintf(name, sizeof name, "%s.bin", FILES[i]);
        take(name, &data, &size);
        for (size_t at = 0; at < size; at++) {
            char was = data[at];
            data[at] = (char)0xff;
            put(name, data, size);
            cn_status status = read_now();
            assert_true(status == CN_OK || status == CN_ERR_FORMAT);
            data[at] = was;
        }
        char count[8];
        memcpy(count, data, 8);
        memset(data, 0xff, 8);
        put(name, data, size);
        assert_int_equal(read_now(), CN_ERR_FORMAT);
        memcpy(data, count, 8);
        put(name, data, size);
        free(data);
    }
}

static void test_bad_text(void **state)
{
    (void)state;
    const struct {
        const char *file, *text, *says;
    } cases[] = {
        { "cameras.txt", "1 DIVISION 640 480 500 500 320 240 0.9\n", "DIVISION" },
        { "cameras.txt", "7 SIMPLE_RADIAL 640 480 500 320 240\n", "parameters" },
        { "cameras.txt", "7 SIMPLE_RADIAL 640 480 500 320 240 0 0\n", "parameters" },
        { "cameras.txt", "7 SIMPLE_RADIAL 0 480 500 320 240 0\n3 PINHOLE 1 1 1 1 1 1\n", "pixels" },
        { "cameras.txt", "7 SIMPLE_RADIAL 640 480 -500 320 240 0\n3 PINHOLE 1 1 1 1 1 1\n", "focal" },
        { "cameras.txt", "7 SIMPLE_RADIAL 640 480 nan 320 240 0\n3 PINHOLE 1 1 1 1 1 1\n", "finite" },
        { "cameras.txt", "7 PINHOLE 1 1 1 1 1 1\n7 PINHOLE 1 1 1 1 1 1\n", "twice" },
        { "cameras.txt", "7 PINHOLE 1 1 1 1 1 1\n", "camera 3" },
        { "images.txt", "1 0 0 0 0 0 0 0 7 a.jpg\n\n", "a.jpg" },
        { "images.txt", "1 1 0 0 0 0 0 0 7 a.jpg\n\n2 1 0 0 0 0 0 0 7 a.jpg\n\n", "photo id 12" },
        { "images.txt", "12 1 0 0 0 0 0 0 7 a.jpg\n1 1 1 2 2 2\n4 1 0 0 0 0 0 0 7 a.jpg\n1 1 1\n", "twice" },
        { "images.txt", "12 1 0 0 0 0 0 0 7 a.jpg\n1 1\n", "three numbers" },
        { "images.txt", "12 1 0 0 0 0 0 0 7\n\n", "name" },
        { "points3D.txt", "5 1 2 nan 10 20 30 0.75 12 1 4 0\n", "finite" },
        { "points3D.txt", "5 1 2 3 10 20 300 0.75 12 1 4 0\n", "colour" },
        { "points3D.txt", "5 1 2 3 10 20 30 0.75 12\n", "pairs" },
        { "points3D.txt", "5 1 2 3 10 20 30 0.75 12 2\n", "keypoint 2" },
        { "points3D.txt", "5 1 2 3 10 20 30 0.75 12 -1\n", "pairs" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        put_text_model();
        put(cases[i].file, cases[i].text, strlen(cases[i].text));
        assert_int_equal(read_now(), CN_ERR_FORMAT);
        assert_non_null(strstr(cn_error_message(), cases[i].says));
    }
    assert_int_equal(cn_scene_read_colmap(&(cn_scene){ 0 }, "/nonexistent"), CN_ERR_IO);
}

static void test_unsupported_lens_binary(void **state)
{
    (void)state;
    char *data;
    size_t size;
    put_binary_model();
    take("cameras.bin", &data, &size);
    data[12] = 11; /* the first camera's model: RAD_TAN_THIN_PRISM_FISHEYE */
    put("cameras.bin", data, size);
    free(data);
    assert_int_equal(read_now(), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "OPENCV_FISHEYE"));
}

static void test_foreign_lens(void **state)
{
    (void)state;
    cn_scene scene;
    double fit_px;
    static const char fisheye[] = "7 RADIAL_FISHEYE 640 480 500.5 320 240 -0.01 0.002\n"
                                  "3 FULL_OPENCV 800 600 700 701 400 300 0.1 -0.02 0.003 -0.004 0.005 0.15 0.01 0\n";
    put_text_model();
    put("cameras.txt", fisheye, sizeof fisheye - 1);
    assert_int_equal(cn_model_read(&scene, folder, &fit_px), CN_OK);
    assert_true(fit_px > 0 && fit_px < 0.5);
    assert_int_equal(scene.cameras[0].lens, CN_LENS_OPENCV_FISHEYE);
    assert_int_equal(scene.cameras[1].lens, CN_LENS_OPENCV);
    cn_scene_deinit(&scene);
}

static void test_keep_and_transform(void **state)
{
    (void)state;
    cn_scene scene;
    put_text_model();
    assert_int_equal(cn_scene_read_colmap(&scene, folder), CN_OK);
    const double turn[9] = { 0, -1, 0, 1, 0, 0, 0, 0, 1 }, shift[3] = { 10, 20, 30 };
    double before[3], after[3], moved[3];
    cn_view_centre(&scene.views[2], before);
    cn_scene_transform(&scene, 2.0, turn, shift);
    cn_view_centre(&scene.views[2], after);
    cn_mat3_vec(turn, before, moved);
    for (int k = 0; k < 3; k++)
        assert_true(fabs(after[k] - (2.0 * moved[k] + shift[k])) < 1e-12);
    assert_true(fabs(scene.points[0].xyz[0] - (10.0 - 4.0)) < 1e-12);
    const bool keep[3] = { true, false, true }, none[3] = { true, false, false };
    assert_int_equal(cn_scene_keep_views(&scene, keep), CN_OK);
    assert_int_equal(scene.n_views, 2);
    assert_int_equal(scene.n_points, 1);
    assert_int_equal(scene.n_observations, 1);
    assert_int_equal(scene.observations[0].view, 1);
    assert_string_equal(scene.views[1].name, "c/a.jpg");
    assert_int_equal(cn_scene_keep_views(&scene, none), CN_OK);
    assert_int_equal(scene.n_points, 0);
    cn_scene_deinit(&scene);
}

/* A photo that its EXIF turns: a point must fall on the same spot of the shown picture. */
static void check_turn(int orientation)
{
    cn_camera camera = { 1, CN_LENS_OPENCV, 400, 300, { 300, 310, 190, 155, -0.1, 0.02, 0.004, -0.007 } };
    cn_view view = { .name = NULL,
                     .camera = 0,
                     .photo = 0,
                     .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 },
                     .translation = { 0.1, 0.2, 0.3 } };
    bool sideways = orientation >= 5;
    char name[] = "p.jpg";
    cn_photo photo = {
        .name = name, .width = sideways ? 600 : 800, .height = sideways ? 800 : 600, .orientation = (uint8_t)orientation
    };
    cn_photo_index index = { .photos = &photo, .n_photos = 1 };
    cn_observation seen = { 0, 30, 40 };
    cn_scene scene = { .cameras = malloc(sizeof camera),
                       .n_cameras = 1,
                       .views = &view,
                       .n_views = 1,
                       .observations = &seen,
                       .n_observations = 1 };
    const double point[3] = { 0.3, -0.4, 2.0 };
    double xyz[3], old[2], now[2];
    bool keep = true;
    *scene.cameras = camera;
    for (int k = 0; k < 3; k++)
        xyz[k] = point[k] + view.translation[k];
    assert_true(cn_camera_project(&camera, xyz, old));
    assert_int_equal(cn_scene_fit_photos(NULL, &scene, &index, true, &keep), CN_OK);
    assert_true(keep);
    cn_mat3_vec(view.rotation, point, xyz);
    for (int k = 0; k < 3; k++)
        xyz[k] += view.translation[k];
    assert_true(cn_camera_project(&scene.cameras[view.camera], xyz, now));
    double expected[3][2] = { { 800 - 2 * old[0], 600 - 2 * old[1] },
                              { 600 - 2 * old[1], 2 * old[0] },
                              { 2 * old[1], 800 - 2 * old[0] } };
    double expected_seen[3][2] = { { 740, 520 }, { 520, 60 }, { 80, 740 } };
    int which = orientation == 3 ? 0 : orientation == 6 ? 1 : 2;
    for (int k = 0; k < 2; k++)
        assert_true(fabs(now[k] - expected[which][k]) < 1e-9);
    assert_true(seen.x_px == expected_seen[which][0] && seen.y_px == expected_seen[which][1]);
    assert_int_equal(scene.cameras[0].width, photo.width);
    free(scene.cameras);
}

static void test_orientation(void **state)
{
    (void)state;
    check_turn(3);
    check_turn(6);
    check_turn(8);
}

static void test_sizes(void **state)
{
    (void)state;
    cn_view view = { .name = (char[]){ "p.jpg" }, .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
    cn_photo photo = { .name = view.name, .width = 1000, .height = 667, .orientation = 2 };
    cn_photo_index index = { .photos = &photo, .n_photos = 1 };
    cn_scene scene = { .cameras = malloc(sizeof(cn_camera)), .n_cameras = 1, .views = &view, .n_views = 1 };
    bool keep = true;
    *scene.cameras = (cn_camera){ 1, CN_LENS_PINHOLE, 3000, 2000, { 2000, 2000, 1500, 1000 } };
    assert_int_equal(cn_scene_fit_photos(NULL, &scene, &index, true, &keep), CN_OK);
    assert_false(keep); /* mirrored */
    photo.orientation = 1;
    keep = true;
    assert_int_equal(cn_scene_fit_photos(NULL, &scene, &index, true, &keep), CN_OK);
    assert_true(keep && scene.cameras[0].width == 1000 && scene.cameras[0].height == 667);
    assert_true(fabs(scene.cameras[0].params[0] - 2000.0 / 3.0) < 1e-9);
    photo.height = 1000;
    assert_int_equal(cn_scene_fit_photos(NULL, &scene, &index, true, &keep), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "1000 x 667"));
    assert_non_null(strstr(cn_error_message(), "1000 x 1000"));
    free(scene.cameras);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_both_formats, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_truncated_binary, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_truncated_text, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_flipped_bytes, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_bad_text, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_unsupported_lens_binary, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_foreign_lens, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(test_keep_and_transform, make_folder, remove_folder),
        cmocka_unit_test(test_orientation),
        cmocka_unit_test(test_sizes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
