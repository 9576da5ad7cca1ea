#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "conurb/pose.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char folder[64], path[96], logged[4096];
static cn_photo photos[3];
static cn_photo_index photo_index;

static void note(void *user, cn_log_level level, const char *text)
{
    (void)user;
    if (level >= CN_LOG_WARN) snprintf(logged + strlen(logged), sizeof logged - strlen(logged), "%s\n", text);
}

static const cn_context CONTEXT = { .log = note };

static int set_up(void **state)
{
    (void)state;
    static char names[3][16] = { "a.jpg", "b.png", "sub/c.jpg" }, images[80];
    strcpy(folder, "/tmp/conurb-json-XXXXXX");
    if (!mkdtemp(folder)) return -1;
    snprintf(path, sizeof path, "%s/transforms.json", folder);
    snprintf(images, sizeof images, "%s/images", folder);
    for (int i = 0; i < 3; i++)
        photos[i] = (cn_photo){ .name = names[i], .width = 640, .height = 480, .orientation = 1 };
    photo_index = (cn_photo_index){ .folder = images, .photos = photos, .n_photos = 3 };
    logged[0] = '\0';
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    unlink(path);
    return rmdir(folder);
}

#define AT(x, y, z) "\"transform_matrix\":[[1,0,0," #x "],[0,1,0," #y "],[0,0,1," #z "],[0,0,0,1]]"
#define FRAME(file) "{\"file_path\":\"" file "\"," AT(1, 2, 3) "}"

static cn_status read_json(const char *text, cn_scene *scene)
{
    assert_int_equal(cn_file_write(path, text, strlen(text)), CN_OK);
    return cn_scene_read_transforms(&CONTEXT, scene, path, &photo_index);
}

static void refused(const char *text, cn_status status, const char *says)
{
    cn_scene scene;
    assert_int_equal(read_json(text, &scene), status);
    assert_non_null(strstr(cn_error_message(), says));
    assert_null(scene.views);
}

static void test_names_and_axes(void **state)
{
    (void)state;
    cn_scene scene;
    assert_int_equal(read_json("{\"fl_x\":500,\"frames\":[" FRAME("images/sub/c.jpg") "," FRAME("./images/a") "," FRAME(
                                   "images/gone.jpg") "," FRAME("b.png") "]}",
                               &scene),
                     CN_OK);
    assert_int_equal(scene.n_views, 3);
    assert_string_equal(scene.views[0].name, "a.jpg");
    assert_string_equal(scene.views[2].name, "sub/c.jpg");
    assert_int_equal(scene.views[2].photo, 2);
    assert_non_null(strstr(logged, "gone.jpg"));
    assert_non_null(strstr(logged, "1 of 4"));
    assert_int_equal(scene.n_cameras, 1);
    assert_int_equal(scene.cameras[0].lens, CN_LENS_PINHOLE);
    assert_true(scene.cameras[0].params[1] == 500 && scene.cameras[0].params[2] == 320);
    double centre[3];
    cn_view_centre(&scene.views[0], centre);
    assert_true(centre[0] == 1 && centre[1] == 2 && centre[2] == 3);
    /* OpenGL's identity looks along -z with y up: a point there is in front, one above it higher in the picture. */
    const double *r = scene.views[0].rotation;
    assert_true(r[0] == 1 && r[4] == -1 && r[8] == -1);
    cn_scene_deinit(&scene);
}

static void test_intrinsics(void **state)
{
    (void)state;
    cn_scene scene;
    assert_int_equal(
        read_json("{\"camera_angle_x\":1.0,\"w\":1280,\"h\":960,\"k1\":0.1,\"frames\":["
                  "{\"file_path\":\"a.jpg\",\"fl_x\":900,\"fl_y\":901,\"cx\":600,\"cy\":500,\"p1\":0.01,"
                  "\"p2\":-0.02," AT(0, 0, 0) "}," FRAME(
                      "b.png") ","
                               "{\"file_path\":\"sub/c.jpg\",\"camera_model\":\"OPENCV_FISHEYE\",\"k4\":0.5," AT(
                                   0, 0, 0) "}]}",
                  &scene),
        CN_OK);
    assert_int_equal(scene.n_cameras, 3);
    const cn_camera *a = &scene.cameras[scene.views[0].camera], *b = &scene.cameras[scene.views[1].camera];
    const cn_camera *c = &scene.cameras[scene.views[2].camera];
    assert_int_equal(a->lens, CN_LENS_OPENCV);
    assert_int_equal(a->width, 640); /* the photos are half as large as the json says */
    const double wanted[8] = { 450, 450.5, 300, 250, 0.1, 0, 0.01, -0.02 };
    for (int i = 0; i < 8; i++)
        assert_true(fabs(a->params[i] - wanted[i]) < 1e-12);
    assert_true(fabs(b->params[0] - 320 / tan(0.5)) < 1e-9 && b->params[1] == b->params[0]);
    assert_int_equal(c->lens, CN_LENS_OPENCV_FISHEYE);
    assert_true(c->params[4] == 0.1 && c->params[7] == 0.5);
    cn_scene_deinit(&scene);
}

/* nerfstudio's OPENCV has k3 and k4, for all frames or in one: they are approximated. */
static void test_more_radial_terms(void **state)
{
    (void)state;
    cn_scene scene;
    assert_int_equal(
        read_json(
            "{\"camera_model\":\"OPENCV\",\"fl_x\":600,\"w\":640,\"h\":480,\"k1\":0.05,\"k3\":0.02,\"frames\":[" FRAME(
                "a.jpg") ",{\"file_path\":\"b.png\",\"k3\":0,\"k4\":-0.03," AT(0, 0, 0) "}]}",
            &scene),
        CN_OK);
    assert_int_equal(scene.n_views, 2);
    for (int i = 0; i < 2; i++) {
        const cn_camera *camera = &scene.cameras[scene.views[i].camera];
        const double at[3] = { 0.4, 0.3, 1 }, s = 0.25; /* its square from the centre */
        const double radial = 1 + s * (0.05 + s * s * (i ? -0.03 * s : 0.02));
        double have[2];
        assert_int_equal(camera->lens, CN_LENS_OPENCV);
        assert_true(cn_camera_project(camera, at, have));
        assert_true(fabs(have[0] - (320 + 600 * 0.4 * radial)) < 0.02);
        assert_true(fabs(have[1] - (240 + 600 * 0.3 * radial)) < 0.02);
    }
    cn_scene_deinit(&scene);
}

/* Barrel distortions with a k3 that folds them back outside the picture. */
static void test_folding_terms(void **state)
{
    (void)state;
    static const double lenses[2][4] = { { 490, -0.27, 0.11, -0.03 }, { 545, -0.1, 0.03, -0.05 } };
    for (int i = 0; i < 2; i++) {
        const double *lens = lenses[i];
        cn_scene scene;
        char text[512];
        snprintf(
            text, sizeof text,
            "{\"camera_model\":\"OPENCV\",\"fl_x\":%g,\"k1\":%g,\"k2\":%g,\"k3\":%g,\"frames\":[" FRAME("a.jpg") "]}",
            lens[0], lens[1], lens[2], lens[3]);
        if (read_json(text, &scene) != CN_OK) fail_msg("%s", cn_error_message());
        for (int k = 1; k <= 10; k++) { /* to the corner */
            const double r = 0.09 * k, s = r * r, at[3] = { 0.8 * r, 0.6 * r, 1 };
            const double bent = lens[0] * r * (1 + s * (lens[1] + s * (lens[2] + s * lens[3])));
            double have[2];
            if (bent > 400) break;
            assert_true(cn_camera_project(&scene.cameras[0], at, have));
            assert_true(hypot(have[0] - (320 + 0.8 * bent), have[1] - (240 + 0.6 * bent)) < 0.64);
        }
        cn_scene_deinit(&scene);
    }
}

static void test_rounded_rotation(void **state)
{
    (void)state;
    cn_scene scene;
    assert_int_equal(read_json("{\"fl_x\":500,\"is_fisheye\":true,\"frames\":[{\"file_path\":\"a.jpg\","
                               "\"transform_matrix\":[[0.6001,0,0.8,1],[0,1.0005,0,2],[-0.8,0,0.5999,3]]}]}",
                               &scene),
                     CN_OK);
    assert_int_equal(scene.cameras[0].lens, CN_LENS_OPENCV_FISHEYE);
    const double *r = scene.views[0].rotation;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double dot = r[3 * i] * r[3 * j] + r[3 * i + 1] * r[3 * j + 1] + r[3 * i + 2] * r[3 * j + 2];
            assert_true(fabs(dot - (i == j)) < 1e-14);
        }
    cn_scene_deinit(&scene);
}

#define ONE(matrix) "{\"fl_x\":5,\"frames\":[{\"file_path\":\"a.jpg\",\"transform_matrix\":" matrix "}]}"

static void test_refused(void **state)
{
    (void)state;
    refused(ONE("[[2,0,0,0],[0,2,0,0],[0,0,2,0],[0,0,0,1]]"), CN_ERR_FORMAT, "rigid");
    refused(ONE("[[-1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"), CN_ERR_FORMAT, "rigid");
    refused(ONE("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,1,1]]"), CN_ERR_FORMAT, "last row");
    refused(ONE("[[1,0,0,null],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"), CN_ERR_FORMAT, "finite");
    refused(ONE("[[1,0,0,1e999],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"), CN_ERR_FORMAT, "JSON");
    refused(ONE("[[1,0,0],[0,1,0],[0,0,1]]"), CN_ERR_FORMAT, "a.jpg");
    refused(ONE("3"), CN_ERR_FORMAT, "a.jpg");
    refused("{\"frames\":[" FRAME("a.jpg") "]}", CN_ERR_FORMAT, "focal");
    refused("{\"fl_x\":-4,\"frames\":[" FRAME("a.jpg") "]}", CN_ERR_FORMAT, "focal");
    refused("{\"fl_x\":\"4\",\"frames\":[" FRAME("a.jpg") "]}", CN_ERR_FORMAT, "fl_x");
    refused("{\"fl_x\":4,\"k3\":1,\"frames\":[" FRAME("a.jpg") "]}", CN_ERR_FORMAT, "photo a.jpg: no lens model");
    refused("{\"fl_x\":4,\"camera_model\":\"OMNIDIRECTIONALSTEREO_L\",\"frames\":[" FRAME("a.jpg") "]}", CN_ERR_FORMAT,
            "OMNIDIRECTIONALSTEREO_L");
    refused("{\"fl_x\":4,\"w\":0,\"frames\":[" FRAME("a.jpg") "]}", CN_ERR_FORMAT, "pixels");
    refused("{\"fl_x\":4,\"w\":500,\"h\":500,\"frames\":[" FRAME("a.jpg") "]}", CN_ERR_DATA, "500 x 500");
    refused("{\"fl_x\":4,\"frames\":[" FRAME("a.jpg") "," FRAME("a") "]}", CN_ERR_FORMAT, "two frames");
    refused("{\"fl_x\":4,\"frames\":[" FRAME("x.jpg") "]}", CN_ERR_DATA, "none");
    refused("{\"fl_x\":4,\"frames\":[]}", CN_ERR_DATA, "none");
    refused("{\"fl_x\":4,\"frames\":[3]}", CN_ERR_FORMAT, "file_path");
    refused("{\"fl_x\":4}", CN_ERR_FORMAT, "frames");
    refused("[]", CN_ERR_FORMAT, "frames");
    refused("{", CN_ERR_FORMAT, "JSON");
}

#define WITH(keys) "{" keys ",\"frames\":[" FRAME("a.jpg") "]}"

/* Each is one line that names the file, the photo and the key. */
static void test_refused_lenses(void **state)
{
    (void)state;
    refused(WITH("\"fl_x\":0"), CN_ERR_FORMAT, "photo a.jpg: fl_x is 0");
    assert_non_null(strstr(cn_error_message(), path));
    refused(WITH("\"fl_x\":0,\"camera_angle_x\":1"), CN_ERR_FORMAT, "fl_x is 0");
    refused(WITH("\"fl_x\":500,\"fl_y\":0"), CN_ERR_FORMAT, "photo a.jpg: fl_y is 0");
    refused(WITH("\"camera_angle_x\":3.2"), CN_ERR_FORMAT, "camera_angle_x is 3.2");
    refused(WITH("\"fl_x\":500,\"k1\":-5"), CN_ERR_FORMAT, "photo a.jpg: the distortion (k1 -5, k2 0) has no inverse");
    assert_non_null(strstr(cn_error_message(), path));
    refused(WITH("\"fl_x\":500,\"k1\":50"), CN_ERR_FORMAT, "photo a.jpg: the distortion (k1 50, k2 0)");
    assert_non_null(strstr(cn_error_message(), path));
    refused(WITH("\"fl_x\":500,\"k1\":0.1,\"k2\":-9"), CN_ERR_FORMAT, "k2 -9");
    refused(WITH("\"fl_x\":300,\"is_fisheye\":true,\"k1\":-5"), CN_ERR_FORMAT, "k1 -5");
    refused(WITH("\"fl_x\":300,\"is_fisheye\":true,\"k1\":50"), CN_ERR_FORMAT, "k1 50");
}

/* Lenses that there are: a long one, whose terms are large and reach nothing; a wide one, whose corners lie past the
 * fold; a round fisheye picture. */
static void test_taken_lenses(void **state)
{
    (void)state;
    static const char *const TEXTS[] = { WITH("\"fl_x\":9000,\"k1\":-5"), WITH("\"fl_x\":9000,\"k1\":50"),
                                         WITH("\"fl_x\":400,\"k1\":-0.33"), WITH("\"fl_x\":500,\"k1\":0.1,\"k2\":0.05"),
                                         WITH("\"fl_x\":76,\"is_fisheye\":true,\"k1\":-0.01") };
    for (size_t i = 0; i < sizeof TEXTS / sizeof *TEXTS; i++) {
        cn_scene scene;
        assert_int_equal(read_json(TEXTS[i], &scene), CN_OK);
        cn_scene_deinit(&scene);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_names_and_axes, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_intrinsics, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_more_radial_terms, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_folding_terms, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_rounded_rotation, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_refused_lenses, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_taken_lenses, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
