/* Poses of other tools: the same three photos, written as each tool writes them, and read as one scene. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "conurb/pose.h"
#include "math/linalg.h"
#include "pose/import.h"
#include "pose/scene.h"
#include "three_photos.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 640, HEIGHT = 480 };
static cn_camera camera; /* the truth */

static int set_up(void **state)
{
    (void)state;
    camera = (cn_camera){ 1, CN_LENS_RADIAL, WIDTH, HEIGHT, { 512, 320, 240, 0.04, -0.02 } };
    return photos_make((const char *const[]){ "a.jpg", "b.png", "sub/c.jpg" }, WIDTH, HEIGHT);
}

static cn_status read_text(const char *text, cn_scene *scene, cn_import_origin *origin)
{
    uint32_t n_models;
    assert_int_equal(cn_file_write(path, text, strlen(text)), CN_OK);
    return cn_import_file(&CONTEXT, path, &photo_index, scene, &n_models, origin);
}

/* One line that names the file and says what is wrong. */
static void refused(const char *text, cn_status wanted, const char *says)
{
    cn_scene scene;
    cn_import_origin origin;
    assert_int_equal(read_text(text, &scene, &origin), wanted);
    if (!strstr(cn_error_message(), says)) fail_msg("\"%s\" does not say \"%s\"", cn_error_message(), says);
    /* Readers name the file; what the photos themselves contradict names the photo. */
    assert_true(wanted == CN_ERR_DATA || strstr(cn_error_message(), path));
    assert_null(strchr(cn_error_message(), '\n'));
    assert_int_equal(scene.n_views, 0);
}

/* Each view projects points before it to the pixels of the truth. */
static void same_pixels(const cn_scene *scene, double within_px)
{
    assert_int_equal(scene->n_views, N);
    for (uint32_t i = 0; i < N; i++) {
        const cn_view *got = &scene->views[i];
        assert_string_equal(got->name, views[i].name);
        for (int p = 0; p < 25; p++) {
            const double at[3] = { 0.25 * (p % 5 - 2), 0.18 * (p / 5 - 2), 1.0 };
            double world[3], cam[3], want[2], have[2];
            for (int k = 0; k < 3; k++)
                cam[k] = 5.0 * at[k] - views[i].translation[k];
            cn_mat3_tvec(views[i].rotation, cam, world);
            cn_mat3_vec(got->rotation, world, cam);
            for (int k = 0; k < 3; k++)
                cam[k] += got->translation[k];
            assert_true(cn_camera_project(&camera, at, want));
            assert_true(cn_camera_project(&scene->cameras[got->camera], cam, have));
            assert_true(hypot(want[0] - have[0], want[1] - have[1]) <= within_px);
        }
    }
}

static void same_poses(const cn_scene *scene, double within)
{
    assert_int_equal(scene->n_views, N);
    for (uint32_t i = 0; i < N; i++) {
        assert_string_equal(scene->views[i].name, views[i].name);
        for (int k = 0; k < 9; k++)
            assert_true(fabs(scene->views[i].rotation[k] - views[i].rotation[k]) <= within);
        for (int k = 0; k < 3; k++)
            assert_true(fabs(scene->views[i].translation[k] - views[i].translation[k]) <= within);
    }
}

/* Rotation vectors, as OpenSfM writes them. */
static void turn_of(const double m[9], double turn[3])
{
    double q[4];
    cn_mat3_to_quat(m, q);
    const double s = cn_norm3(q + 1), angle = 2.0 * atan2(s, q[0]);
    for (int k = 0; k < 3; k++)
        turn[k] = s > 0.0 ? angle * q[1 + k] / s : 0.0;
}

#define PLACE "\"reference_lla\": {\"latitude\": 47.5, \"longitude\": 8.25, \"altitude\": 400},"
#define PERSPECTIVE                                                                                                    \
    "\"cam\": {\"projection_type\": \"perspective\", \"width\": 640, \"height\": 480, \"focal\": 0.8, \"k1\": 0.04, "  \
    "\"k2\": -0.02}"

/* A reconstruction.json with these cameras; `more` goes in front of its shots. */
static const char *opensfm(const char *cameras, const char *more)
{
    static char text[4096];
    int n = snprintf(text, sizeof text, "[{\"shots\": {}}, {\"cameras\": {%s}, %s \"shots\": {", cameras, more);
    for (int i = 0; i < N; i++) {
        double turn[3];
        turn_of(views[i].rotation, turn);
        n += snprintf(text + n, sizeof text - (size_t)n,
                      "%s\"%s\": {\"rotation\": [%.17g, %.17g, %.17g], \"translation\": [%.17g, %.17g, %.17g], "
                      "\"camera\": \"cam\", \"orientation\": 1, \"capture_time\": 0.0, \"gps_dop\": 5.0}",
                      i ? ", " : "", views[i].name, turn[0], turn[1], turn[2], views[i].translation[0],
                      views[i].translation[1], views[i].translation[2]);
    }
    snprintf(text + n, sizeof text - (size_t)n, "}, \"points\": {}}]");
    return text;
}

static void test_opensfm(void **state)
{
    (void)state;
    cn_scene scene;
    cn_import_origin origin;
    begin("reconstruction.json");
    assert_int_equal(read_text(opensfm(PERSPECTIVE, PLACE), &scene, &origin), CN_OK);
    same_poses(&scene, 1e-12);
    same_pixels(&scene, 1e-9);
    cn_scene_deinit(&scene);
    assert_true(origin.known && origin.sea_level);
    assert_true(origin.latitude_deg == 47.5 && origin.longitude_deg == 8.25 && origin.height_m == 400);
    assert_int_equal(read_text(opensfm(PERSPECTIVE, ""), &scene, &origin), CN_OK);
    assert_false(origin.known);
    cn_scene_deinit(&scene);
}

/* Brown with a centre and tangential terms; and with a k3, which cn_lens lacks. */
static void test_opensfm_brown(void **state)
{
    (void)state;
    static const char BROWN[] =
        "\"cam\": {\"projection_type\": \"brown\", \"width\": 640, \"height\": 480, \"focal_x\": 0.8, \"focal_y\": "
        "0.81, \"c_x\": 0.01, \"c_y\": -0.02, \"k1\": 0.04, \"k2\": -0.02, \"k3\": %g, \"p1\": 0.001, \"p2\": -0.002}";
    char text[512];
    cn_scene scene;
    cn_import_origin origin;
    begin("reconstruction.json");
    camera =
        (cn_camera){ 1, CN_LENS_OPENCV, WIDTH, HEIGHT, { 512, 0.81 * 640, 326.4, 227.2, 0.04, -0.02, 0.001, -0.002 } };
    snprintf(text, sizeof text, BROWN, 0.0);
    assert_int_equal(read_text(opensfm(text, ""), &scene, &origin), CN_OK);
    same_pixels(&scene, 1e-9);
    cn_scene_deinit(&scene);
    snprintf(text, sizeof text, BROWN, 0.01);
    assert_int_equal(read_text(opensfm(text, ""), &scene, &origin), CN_OK);
    /* r^6 is 0.1 at the outermost test points: without the fit this would be off by 0.4 px. */
    same_pixels(&scene, 1.0);
    const cn_camera *c = &scene.cameras[0];
    const double at[3] = { 0.5, 0.36, 1.0 }, s = 0.5 * 0.5 + 0.36 * 0.36;
    const double radial = 1.0 + s * (0.04 + s * (-0.02 + s * 0.01));
    const double x = 0.5 * radial + 2 * 0.001 * 0.5 * 0.36 - 0.002 * (s + 2 * 0.25);
    double have[2];
    assert_true(cn_camera_project(c, at, have));
    assert_true(fabs(have[0] - (326.4 + 512 * x)) < 0.02);
    cn_scene_deinit(&scene);
    snprintf(text, sizeof text, BROWN, 40.0);
    refused(opensfm(text, ""), CN_ERR_FORMAT, "photo a.jpg: no lens model");
}

static void test_opensfm_faults(void **state)
{
    (void)state;
    begin("reconstruction.json");
    refused("[{\"cameras\": {}, \"shots\": {\"a.jpg\":", CN_ERR_FORMAT, "not valid JSON");
    refused("[]", CN_ERR_FORMAT, "no reconstruction with shots");
    refused(opensfm("", ""), CN_ERR_FORMAT, "photo a.jpg names camera \"cam\", which does not exist");
    refused(opensfm("\"cam\": {\"projection_type\": \"dual\", \"width\": 640, \"height\": 480}", ""), CN_ERR_FORMAT,
            "is of type dual");
    refused(
        opensfm("\"cam\": {\"projection_type\": \"perspective\", \"width\": 640, \"height\": 480, \"focal\": 0}", ""),
        CN_ERR_FORMAT, "focal length 0");
    refused(opensfm(PERSPECTIVE, "\"reference_lla\": {\"latitude\": 147, \"longitude\": 8},"), CN_ERR_FORMAT,
            "not a place on Earth");
    refused(
        opensfm("\"cam\": {\"projection_type\": \"perspective\", \"width\": 480, \"height\": 480, \"focal\": 1}", ""),
        CN_ERR_DATA, "another aspect ratio");
    refused("[{\"cameras\": {" PERSPECTIVE "}, \"shots\": {\"a.jpg\": {\"rotation\": [0, 0], \"translation\": [0, 0, "
            "0], \"camera\": \"cam\"}}}]",
            CN_ERR_FORMAT, "photo a.jpg: \"rotation\"");
    refused("[{\"cameras\": {" PERSPECTIVE "}, \"shots\": {\"x.jpg\": {}}}]", CN_ERR_DATA, "none of its 1 frames");
    assert_non_null(strstr(logged, "photo x.jpg is not in the collection"));
    refused("not at all", CN_ERR_FORMAT, "no tool that Conurb knows");
}

/* The text of a .nvm of these photos; `head` goes after NVM_V3. The centre of a camera is -R^T t. */
static const char *nvm(const char *head, double focal, double radial)
{
    static char text[4096];
    int n = snprintf(text, sizeof text, "NVM_V3 %s\r\n \r\n1\r\nother.jpg 9 1 0 0 0 0 0 0 0 0\r\n0\r\n%d\r\n", head, N);
    for (int i = 0; i < N; i++) {
        double q[4], centre[3];
        cn_mat3_to_quat(views[i].rotation, q);
        cn_mat3_tvec(views[i].rotation, views[i].translation, centre);
        n += snprintf(text + n, sizeof text - (size_t)n,
                      "%s\t%.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g 0 \r\n", views[i].name, focal, q[0],
                      q[1], q[2], q[3], -centre[0], -centre[1], -centre[2], radial);
    }
    snprintf(text + n, sizeof text - (size_t)n,
             "\r\n2\r\n0 0 5 255 0 0 1 0 7 0.5 0.5\r\n1 0 5 0 0 0 0\r\n0\r\n# end\r\n");
    return text;
}

/* Of two models the one with more photos. Poses as they were, and places in the picture within the lens's fit. */
static void test_nvm(void **state)
{
    (void)state;
    cn_scene scene;
    cn_import_origin origin;
    double have[2];
    begin("city.nvm");
    camera = (cn_camera){ 1, CN_LENS_PINHOLE, WIDTH, HEIGHT, { 500, 500, 320, 240 } };
    assert_int_equal(read_text(nvm("", 500, 0), &scene, &origin), CN_OK);
    same_poses(&scene, 1e-12);
    same_pixels(&scene, 1e-9);
    cn_scene_deinit(&scene);
    assert_int_equal(read_text(nvm("", 500, -0.05), &scene, &origin), CN_OK);
    same_poses(&scene, 1e-12);
    /* m = (0.48, 0.36) is seen where m (1 - 0.05 |m|^2) goes without distortion. */
    const double s = 1 - 0.05 * 0.36, straight[3] = { 0.48 * s, 0.36 * s, 1 };
    assert_true(cn_camera_project(&scene.cameras[0], straight, have));
    assert_true(fabs(have[0] - (320 + 500 * 0.48)) < 0.02 && fabs(have[1] - (240 + 500 * 0.36)) < 0.02);
    cn_scene_deinit(&scene);
    camera = (cn_camera){ 1, CN_LENS_PINHOLE, WIDTH, HEIGHT, { 510, 490, 330, 235 } };
    assert_int_equal(read_text(nvm("FixedK 510 330 490 235 0", 500, 0.3), &scene, &origin), CN_OK);
    same_pixels(&scene, 1e-9);
    cn_scene_deinit(&scene);
    static char blank[] = "a b.jpg";
    photos[0].name = views[0].name = blank; /* COLMAP writes the blank; VisualSfM a quotation mark */
    for (int k = 0; k < 2; k++) {
        char *text = strdup(nvm("", 500, 0)), *name = strstr(text, "a b.jpg");
        assert_non_null(name);
        if (k) name[1] = '"';
        assert_int_equal(read_text(text, &scene, &origin), CN_OK);
        assert_int_equal(scene.n_views, N);
        cn_scene_deinit(&scene);
        free(text);
    }
}

static void cut(const char *text, const char *after, const char *says)
{
    char copy[4096];
    snprintf(copy, sizeof copy, "%s", text);
    char *at = strstr(copy, after);
    assert_non_null(at);
    at[strlen(after)] = '\0';
    refused(copy, CN_ERR_FORMAT, says);
}

static void test_nvm_faults(void **state)
{
    (void)state;
    begin("city.nvm");
    refused("NVM_V3 \n", CN_ERR_FORMAT, "no model with photos");
    refused("NVM_V3 \n0\n", CN_ERR_FORMAT, "no model with photos");
    refused("NVM_V3 FixedK 1 2 3\n", CN_ERR_FORMAT, "line 1: fx, cx, fy, cy and a radial term");
    refused("NVM_V3\n2\na.jpg 9 1 0 0 0 0 0 0 0 0\n", CN_ERR_FORMAT, "is 2, but 1 lines follow");
    refused("NVM_V3\n1\na.jpg 9 1 0 0 0 0 0 0 0 0\n", CN_ERR_FORMAT, "ends before the number of points");
    refused("NVM_V3\n1\na.jpg 9 1 0 0\n0\n", CN_ERR_FORMAT, "line 3: a name and 10 numbers");
    refused("NVM_V3\n1\na.jpg 9 1 0 0 0 0 nan 0 0 0\n0\n", CN_ERR_FORMAT, "line 3: a name and 10 numbers");
    refused("NVM_V3\n1\na.jpg 9 1 1 0 0 0 0 0 0 0\n0\n", CN_ERR_FORMAT, "line 3: a rotation of length 1");
    refused("NVM_V3\n1\na.jpg 0 1 0 0 0 0 0 0 0 0\n0\n", CN_ERR_FORMAT, "photo a.jpg: focal length 0");
    refused("NVM_V3\n1\na.jpg 500 1 0 0 0 0 0 0 90 0\n0\n", CN_ERR_FORMAT, "no lens model of Conurb");
    refused("NVM_V3\n2\na.jpg 9 1 0 0 0 0 0 0 0 0\na.jpg 9 1 0 0 0 0 0 0 0 0\n0\n", CN_ERR_FORMAT,
            "two frames name photo");
    refused("NVM_V3\n1\nx.jpg 9 1 0 0 0 0 0 0 0 0\n0\n", CN_ERR_DATA, "none of its 1 frames");
    cut(nvm("", 500, 0), "sub/c.jpg", "");
    cut(nvm("", 500, 0), "0 0 5 255", "is 2, but 1 lines follow");
}

static void write_list(const char *name, const char *text)
{
    char at[160];
    snprintf(at, sizeof at, "%s/%s", folder, name);
    assert_int_equal(cn_file_write(at, text, strlen(text)), CN_OK);
}

/* A bundle.out of these photos, the second of which has no pose when `without` is set. */
static const char *bundler(bool without)
{
    static char text[4096];
    int n = snprintf(text, sizeof text, "# Bundle file v0.3\n%d 1\n", N);
    for (int i = 0; i < N; i++) {
        const double *r = views[i].rotation, *t = views[i].translation;
        const double f = without && i == 1 ? 0.0 : camera.params[0];
        n += snprintf(text + n, sizeof text - (size_t)n, "%.17g %.17g %.17g\n", f, camera.params[3], camera.params[4]);
        for (int row = 0; row < 3; row++)
            n += snprintf(text + n, sizeof text - (size_t)n, "%.17g %.17g %.17g\n", (row ? -1 : 1) * r[3 * row],
                          (row ? -1 : 1) * r[3 * row + 1], (row ? -1 : 1) * r[3 * row + 2]);
        n += snprintf(text + n, sizeof text - (size_t)n, "%.17g %.17g %.17g\n", t[0], -t[1], -t[2]);
    }
    snprintf(text + n, sizeof text - (size_t)n, "0 0 5\n255 0 0\n1 0 7 0.5 0.5\n");
    return text;
}

static void test_bundler(void **state)
{
    (void)state;
    cn_scene scene;
    cn_import_origin origin;
    begin("bundle.out");
    write_list("list.txt", "./a.jpg 0 512.5\nimages/b.png\nsub/c.jpg 0\n");
    assert_int_equal(read_text(bundler(false), &scene, &origin), CN_OK);
    same_poses(&scene, 1e-12);
    same_pixels(&scene, 1e-9);
    cn_scene_deinit(&scene);
    assert_int_equal(read_text(bundler(true), &scene, &origin), CN_OK);
    assert_int_equal(scene.n_views, N - 1);
    cn_scene_deinit(&scene);
    begin("x.bundle.out"); /* as COLMAP names them */
    write_list("x.list.txt", "a.jpg\nb.png\nsub/c.jpg\n");
    write_list("list.txt", "one.jpg\n");
    assert_int_equal(read_text(bundler(false), &scene, &origin), CN_OK);
    same_poses(&scene, 1e-12);
    cn_scene_deinit(&scene);
}

static void test_bundler_faults(void **state)
{
    (void)state;
    begin("bundle.out");
    refused(bundler(false), CN_ERR_FORMAT, "the list of its photos is missing");
    write_list("list.txt", "a.jpg\nb.png\n");
    refused(bundler(false), CN_ERR_FORMAT, "it has 3 photos, but");
    write_list("list.txt", "a.jpg\nb.png\nsub/c.jpg\n");
    refused("# Bundle file v0.3\n", CN_ERR_FORMAT, "ends before the numbers of photos and points");
    refused("# Bundle file v0.3\n3 x\n", CN_ERR_FORMAT, "line 2: the numbers of photos and points");
    refused("# Bundle file v0.3\n-3 1\n", CN_ERR_FORMAT, "line 2: the numbers of photos and points");
    cut(bundler(false), "0 0 5\n", "too short for 3 photos and 1 points");
    char *text = strdup(bundler(false)), *end = strstr(text, "\n0 0 5");
    assert_non_null(end);
    end[-1] = 'x';
    refused(text, CN_ERR_FORMAT, "line 17: three numbers of a translation");
    free(text);
    text = strdup(bundler(false));
    char *first = strstr(text, "\n1 0 0");
    assert_non_null(first);
    first[1] = '7';
    refused(text, CN_ERR_FORMAT, "line 4: a rotation expected");
    free(text);
    write_list("list.txt", "x.jpg\ny.jpg\nz.jpg\n");
    refused(bundler(false), CN_ERR_DATA, "none of its 3 frames");
}

static void give_gps(double latitude_deg)
{
    for (int i = 0; i < N; i++) {
        photos[i].has_gps = true;
        photos[i].latitude_deg = latitude_deg;
        photos[i].longitude_deg = 8.25;
    }
    photo_index.n_gps = N;
}

/* The file's own origin holds unless the photos' GPS contradicts it. */
static void test_place(void **state)
{
    (void)state;
    cn_import_origin origin = { .known = true, .latitude_deg = 47.5, .longitude_deg = 8.25, .height_m = 400 };
    cn_scene scene = { .cameras = &camera, .n_cameras = 1, .views = views, .n_views = N };
    cn_frame frame;
    const double was = views[2].translation[0];
    assert_int_equal(cn_import_place(&CONTEXT, &scene, &photo_index, 5.0, &origin, &frame), CN_OK);
    assert_true(frame.georeferenced && frame.latitude_deg == 47.5 && frame.height_m == 400);
    assert_true(frame.geoid_applied); /* Metashape's heights are above the ellipsoid: no less so than converted ones */
    origin.sea_level = true;
    assert_int_equal(cn_import_place(&CONTEXT, &scene, &photo_index, 5.0, &origin, &frame), CN_OK);
    assert_true(frame.height_m == 400 + frame.geoid_height_m && frame.geoid_applied == (frame.geoid_height_m != 0));
    origin.sea_level = false;
    assert_int_equal(frame.n_gps, 0);
    give_gps(47.5);
    assert_int_equal(cn_import_place(&CONTEXT, &scene, &photo_index, 5.0, &origin, &frame), CN_OK);
    assert_true(frame.georeferenced && frame.residual_horizontal_m > 0.1 && frame.residual_horizontal_m < 7);
    assert_true(views[2].translation[0] == was);
    give_gps(47.6);
    assert_int_equal(cn_import_place(&CONTEXT, &scene, &photo_index, 5.0, &origin, &frame), CN_OK);
    assert_non_null(strstr(logged, "the poses are aligned to GPS instead"));
    assert_false(frame.georeferenced); /* all at one place */
}

/* The folder of an ODM project, through the whole stage. */
static void test_odm_folder(void **state)
{
    (void)state;
    cn_pose_options options = cn_pose_options_default();
    cn_pose_report report;
    cn_frame frame;
    char work[128], frame_path[128], project[128];
    snprintf(project, sizeof project, "%s/odm", folder);
    snprintf(work, sizeof work, "%s/poses", folder);
    snprintf(frame_path, sizeof frame_path, "%s/frame.json", folder);
    begin("odm/opensfm/reconstruction.json");
    assert_int_equal(cn_folder_of_make(path), CN_OK);
    const char *text = opensfm(PERSPECTIVE, PLACE);
    assert_int_equal(cn_file_write(path, text, strlen(text)), CN_OK);
    options.import = project;
    assert_int_equal(cn_pose_run(&CONTEXT, &photo_index, work, frame_path, &options, &report), CN_OK);
    assert_int_equal(report.n_registered, N);
    assert_int_equal(report.n_models, 2);
    cn_pose_report_deinit(&report);
    assert_int_equal(cn_frame_load(&frame, frame_path), CN_OK);
    assert_true(frame.georeferenced && frame.latitude_deg == 47.5);
    cn_scene scene;
    assert_int_equal(cn_pose_load(NULL, work, &photo_index, &scene), CN_OK);
    same_poses(&scene, 1e-9);
    cn_scene_deinit(&scene);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, photos_remove)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_opensfm),    TEST(test_opensfm_brown), TEST(test_opensfm_faults), TEST(test_nvm),
        TEST(test_nvm_faults), TEST(test_bundler),       TEST(test_bundler_faults), TEST(test_place),
        TEST(test_odm_folder),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
