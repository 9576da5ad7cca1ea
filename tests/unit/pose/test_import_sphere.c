/* Photos of all directions, as the tools that know them write them, and COLMAP models that share a lens or have rigs:
 * the same three photos, read as the COLMAP model that they were made from. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "conurb/pose.h"
#include "math/linalg.h"
#include "pose/import.h"
#include "pose/lens.h"
#include "pose/scene.h"
#include "three_photos.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static cn_camera cameras[N]; /* the truth: one for each photo */

static int set_up(void **state)
{
    (void)state;
    if (photos_make((const char *const[]){ "a.jpg", "b.jpg", "c.jpg" }, 640, 320) != 0) return -1;
    for (int i = 0; i < N; i++) {
        views[i].camera = (uint32_t)i;
        cameras[i] = cn_camera_equirectangular(640, 320);
        cameras[i].id = (uint32_t)i + 1;
    }
    return 0;
}

static cn_status import(const char *what, cn_scene *scene)
{
    uint32_t n_models;
    cn_import_origin origin;
    assert_int_equal(cn_folder_of_make(path), CN_OK);
    assert_int_equal(cn_file_write(path, what, strlen(what)), CN_OK);
    return cn_import_file(&CONTEXT, path, &photo_index, scene, &n_models, &origin);
}

/* One line that says what is wrong. */
static void refused(const char *what, const char *says)
{
    cn_scene scene;
    const cn_status status = import(what, &scene);
    assert_true(status == CN_ERR_FORMAT || status == CN_ERR_DATA);
    if (!strstr(cn_error_message(), says)) fail_msg("\"%s\" does not say \"%s\"", cn_error_message(), says);
    assert_null(strchr(cn_error_message(), '\n'));
    assert_int_equal(scene.n_views, 0);
}

/* Poses as they were, and each point of the world at the pixel where the truth has it, in all directions that the
 * truth shows. */
static void same(const cn_scene *scene)
{
    assert_int_equal(scene->n_views, N);
    for (uint32_t i = 0; i < N; i++) {
        const cn_view *got = &scene->views[i];
        assert_string_equal(got->name, views[i].name);
        for (int k = 0; k < 9; k++)
            assert_true(fabs(got->rotation[k] - views[i].rotation[k]) < 1e-9);
        for (int k = 0; k < 3; k++)
            assert_true(fabs(got->translation[k] - views[i].translation[k]) < 1e-9);
        uint32_t seen = 0;
        for (int p = 0; p < 125; p++) {
            const double cam[3] = { p % 5 - 2.1, p / 5 % 5 - 2.1, p / 25 - 2.1 };
            double want[2], have[2];
            if (!cn_camera_project(&cameras[i], cam, want)) continue;
            seen++;
            assert_true(cn_camera_project(&scene->cameras[got->camera], cam, have));
            assert_true(hypot(want[0] - have[0], want[1] - have[1]) < 1e-6);
        }
        assert_true(seen >= (cameras[i].lens == CN_LENS_EQUIRECTANGULAR ? 125u : 25u));
    }
}

static void say_matrix(int i, double sign, const char *row_begin, const char *between, const char *row_end)
{
    double m[16];
    world_from_cam(i, sign, m);
    for (int row = 0; row < 4; row++) {
        say("%s", row_begin);
        for (int c = 0; c < 4; c++)
            say("%.17g%s", m[4 * row + c], c < 3 ? between : row_end);
        if (row < 3) say("%s", between);
    }
}

/* ---- nerfstudio ---- */

static void transforms(const char *head)
{
    say("{%s\"frames\": [", head);
    for (int i = 0; i < N; i++) {
        say("%s{\"file_path\": \"%s\", \"transform_matrix\": [", i ? ", " : "", views[i].name);
        say_matrix(i, -1, "[", ",", "]");
        say("]}");
    }
    say("]}");
}

static void test_nerfstudio(void **state)
{
    (void)state;
    cn_scene scene;
    begin("transforms.json");
    /* Larger than the photos, as the files of ns-process-data may be. */
    transforms("\"camera_model\": \"EQUIRECTANGULAR\", \"w\": 1280, \"h\": 640, \"fl_x\": 640, \"fl_y\": 640, "
               "\"cx\": 640, \"cy\": 320,");
    assert_int_equal(import(said, &scene), CN_OK);
    same(&scene);
    assert_int_equal(scene.n_cameras, 1);
    cn_scene_deinit(&scene);
    refused(changed("\"fl_x\": 640", "\"fl_x\": 500"), "photo a.jpg is equirectangular and 1280 pixels wide, but fl_x");
    refused(changed("\"h\": 640", "\"h\": 720"), "1280 x 720 pixels, but such a picture is twice as wide as high");
    said[strlen(said) / 2] = '\0';
    refused(said, "not valid JSON");
    begin("transforms.json");
    transforms("\"camera_model\": \"EQUIRECTANGULAR\",");
    assert_int_equal(import(said, &scene), CN_OK);
    same(&scene);
    cn_scene_deinit(&scene);
    photos[1].height = 400;
    refused(said, "photo b.jpg is a picture of all directions, 640 x 400 pixels");
}

/* Three lenses in one file, each in its frame. */
static void test_nerfstudio_frames(void **state)
{
    (void)state;
    static const char *const LENSES[N] = {
        "\"camera_model\": \"OPENCV\", \"fl_x\": 400, \"fl_y\": 410, \"cx\": 330, \"cy\": 150, \"k1\": 0.05, "
        "\"k2\": -0.01, \"p1\": 0.001, \"p2\": -0.002,",
        "\"camera_model\": \"OPENCV_FISHEYE\", \"fl_x\": 200, \"fl_y\": 201, \"cx\": 321, \"cy\": 159, \"k1\": 0.02, "
        "\"k2\": -0.004, \"k3\": 0.001, \"k4\": -0.0002,",
        "\"camera_model\": \"EQUIRECTANGULAR\","
    };
    cn_scene scene;
    cameras[0] = (cn_camera){ 1, CN_LENS_OPENCV, 640, 320, { 400, 410, 330, 150, 0.05, -0.01, 0.001, -0.002 } };
    cameras[1] =
        (cn_camera){ 2, CN_LENS_OPENCV_FISHEYE, 640, 320, { 200, 201, 321, 159, 0.02, -0.004, 0.001, -0.0002 } };
    begin("transforms.json");
    say("{\"frames\": [");
    for (int i = 0; i < N; i++) {
        say("%s{%s \"w\": 640, \"h\": 320, \"file_path\": \"%s\", \"transform_matrix\": [", i ? ", " : "", LENSES[i],
            views[i].name);
        say_matrix(i, -1, "[", ",", "]");
        say("]}");
    }
    say("]}");
    assert_int_equal(import(said, &scene), CN_OK);
    assert_int_equal(scene.n_cameras, 3);
    same(&scene);
    cn_scene_deinit(&scene);
    refused(changed("OPENCV_FISHEYE", "FOV"), "camera_model FOV is not supported");
}

/* ---- OpenSfM, ODM, Metashape ---- */

static void opensfm(const char *type)
{
    say("[{\"cameras\": {\"v2 theta\": {\"projection_type\": \"%s\", \"width\": 640, \"height\": 320}}, \"shots\": {",
        type);
    for (int i = 0; i < N; i++) {
        double q[4];
        cn_mat3_to_quat(views[i].rotation, q);
        const double s = cn_norm3(q + 1), turn = s > 0 ? 2 * atan2(s, q[0]) / s : 0;
        say("%s\"%s\": {\"rotation\": [%.17g, %.17g, %.17g], \"translation\": [%.17g, %.17g, %.17g], \"camera\": "
            "\"v2 theta\"}",
            i ? ", " : "", views[i].name, turn * q[1], turn * q[2], turn * q[3], views[i].translation[0],
            views[i].translation[1], views[i].translation[2]);
    }
    say("}}]");
}

static void test_opensfm(void **state)
{
    (void)state;
    static const char *const TYPES[2] = { "spherical", "equirectangular" };
    for (int k = 0; k < 2; k++) {
        cn_scene scene;
        begin("reconstruction.json");
        opensfm(TYPES[k]);
        assert_int_equal(import(said, &scene), CN_OK);
        same(&scene);
        cn_scene_deinit(&scene);
    }
    refused(changed("\"height\": 320", "\"height\": 480"), "photo a.jpg is a picture of all directions, 640 x 480");
    refused(changed("\"width\": 640", "\"width\": 0"), "no size of a photo");
    refused(changed("equirectangular", "cubemap"), "is of type cubemap");
}

static void test_metashape(void **state)
{
    (void)state;
    cn_scene scene;
    begin("cameras.xml");
    say("<?xml version=\"1.0\"?>\n<document version=\"1.5.0\"><chunk label=\"1\" enabled=\"true\"><sensors><sensor "
        "id=\"0\" label=\"360\" type=\"spherical\"><resolution width=\"640\" height=\"320\"/></sensor></sensors>"
        "<cameras>\n");
    for (int i = 0; i < N; i++) {
        say("<camera id=\"%d\" sensor_id=\"0\" label=\"%s\"><transform>", i, views[i].name);
        say_matrix(i, 1, "", " ", "");
        say("</transform></camera>\n");
    }
    say("</cameras></chunk></document>\n");
    assert_int_equal(import(said, &scene), CN_OK);
    same(&scene);
    cn_scene_deinit(&scene);
    refused(changed("height=\"320\"", "height=\"300\""), "photo a.jpg is a picture of all directions, 640 x 300");
    refused(changed("spherical", "cylindrical"), "supported are frame, fisheye and spherical");
}

/* ---- COLMAP ---- */

static void write_model(const char *name, const char *what)
{
    begin(name);
    assert_int_equal(cn_folder_of_make(path), CN_OK);
    assert_int_equal(cn_file_write(path, what, strlen(what)), CN_OK);
}

/* As `colmap model_converter` writes it: one camera for all photos; COLMAP 4 puts rigs and frames beside. */
static void text_model(const char *lens)
{
    char images[2048] = "";
    for (int i = 0; i < N; i++) {
        double q[4];
        cn_mat3_to_quat(views[i].rotation, q);
        const double *t = views[i].translation;
        snprintf(images + strlen(images), sizeof images - strlen(images),
                 "%d %.17g %.17g %.17g %.17g %.17g %.17g %.17g 7 %s\n\n", i + 1, q[0], q[1], q[2], q[3], t[0], t[1],
                 t[2], views[i].name);
    }
    write_model("model/cameras.txt", lens);
    write_model("model/images.txt", images);
    write_model("model/points3D.txt", "");
    write_model("model/rigs.txt", "# RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID\n1 1 CAMERA 7\n");
    write_model("model/frames.txt", "# FRAME_ID, RIG_ID, RIG_FROM_WORLD, DATA_IDS\n1 1 1 0 0 0 0 0 0 1 CAMERA 7 1\n");
    snprintf(path, sizeof path, "%s/model", folder);
}

static void test_colmap(void **state)
{
    (void)state;
    cn_scene scene, again;
    text_model("7 EQUIRECTANGULAR 640 320 640 320\n");
    assert_int_equal(cn_scene_read_colmap(&scene, path), CN_OK);
    assert_int_equal(scene.n_cameras, 1);
    same(&scene);
    /* Binary, with rigs and frames beside, whose bytes are none of ours to read. */
    snprintf(path, sizeof path, "%s/binary", folder);
    assert_int_equal(cn_scene_write_colmap(&scene, path), CN_OK);
    cn_scene_deinit(&scene);
    char beside[200];
    snprintf(beside, sizeof beside, "%s/rigs.bin", path);
    assert_int_equal(cn_file_write(beside, "\1\0\0\0\0\0\0\0", 8), CN_OK);
    snprintf(beside, sizeof beside, "%s/frames.bin", path);
    assert_int_equal(cn_file_write(beside, "\1\0\0\0\0\0\0\0", 8), CN_OK);
    assert_int_equal(cn_scene_read_colmap(&again, path), CN_OK);
    assert_int_equal(again.n_cameras, 1);
    same(&again);
    cn_scene_deinit(&again);
    text_model("7 OPENCV 640 320 400 410 330 150 0.05 -0.01 0.001 -0.002\n");
    for (int i = 0; i < N; i++)
        cameras[i] = (cn_camera){ 7, CN_LENS_OPENCV, 640, 320, { 400, 410, 330, 150, 0.05, -0.01, 0.001, -0.002 } };
    assert_int_equal(cn_scene_read_colmap(&scene, path), CN_OK);
    assert_int_equal(scene.n_cameras, 1); /* shared by all */
    same(&scene);
    cn_scene_deinit(&scene);
}

static void test_colmap_faults(void **state)
{
    (void)state;
    cn_scene scene;
    text_model("7 EQUIRECTANGULAR 640 320 640 300\n");
    assert_int_equal(cn_scene_read_colmap(&scene, path), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "a picture of a part of the sphere"));
    text_model("7 EQUIRECTANGULAR 640 320 640\n");
    assert_int_equal(cn_scene_read_colmap(&scene, path), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "the wrong number of parameters"));
    text_model("9 EQUIRECTANGULAR 640 320 640 320\n");
    assert_int_equal(cn_scene_read_colmap(&scene, path), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "camera"));
}

/* A photo on its side cannot be turned upright: rows are latitudes. Upside down, it can. */
static void test_orientation(void **state)
{
    (void)state;
    cn_scene scene;
    for (int i = 0; i < 2; i++) {
        bool keep[N] = { true, true, true };
        begin("transforms.json");
        transforms("\"camera_model\": \"EQUIRECTANGULAR\", \"w\": 640, \"h\": 320,");
        assert_int_equal(import(said, &scene), CN_OK);
        photos[1].orientation = i ? 6 : 3;
        if (i) photos[1].width = 320, photos[1].height = 640;
        for (int v = 0; v < N; v++)
            scene.views[v].photo = (uint32_t)v;
        assert_int_equal(cn_scene_fit_photos(&CONTEXT, &scene, &photo_index, true, keep), CN_OK);
        assert_int_equal(keep[1], i == 0);
        cn_scene_deinit(&scene);
    }
    assert_non_null(strstr(logged, "photo b.jpg is turned or mirrored"));
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, photos_remove)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_nerfstudio), TEST(test_nerfstudio_frames), TEST(test_opensfm),     TEST(test_metashape),
        TEST(test_colmap),     TEST(test_colmap_faults),     TEST(test_orientation),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
