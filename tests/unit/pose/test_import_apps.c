/* Poses of Metashape, RealityCapture, Polycam and Record3D: the same three photos, written as each of them documents
 * its files, and read as the COLMAP model that they were made from. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "base/units.h"
#include "conurb/pose.h"
#include "math/linalg.h"
#include "pose/import.h"
#include "three_photos.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 640, HEIGHT = 480 };
static cn_camera camera; /* the truth */
static const double SAME[9] = { 1, 0, 0, 0, 1, 0, 0, 0, 1 };

static int set_up(void **state)
{
    (void)state;
    camera = (cn_camera){ 1, CN_LENS_OPENCV, WIDTH, HEIGHT, { 512, 512, 326.4, 227.2, 0.04, -0.02, 0.001, -0.002 } };
    return photos_make((const char *const[]){ "0.jpg", "1.png", "sub/2.jpg" }, WIDTH, HEIGHT);
}

static cn_status import(const char *what, cn_scene *scene, uint32_t *n_models, cn_import_origin *origin)
{
    assert_int_equal(cn_folder_of_make(path), CN_OK);
    assert_int_equal(cn_file_write(path, what, strlen(what)), CN_OK);
    return cn_import_file(NULL, path, &photo_index, scene, n_models, origin);
}

/* One line that names the file and says what is wrong. */
static void refused(const char *what, cn_status wanted, const char *says)
{
    cn_scene scene;
    cn_import_origin origin;
    uint32_t n_models;
    assert_int_equal(import(what, &scene, &n_models, &origin), wanted);
    if (!strstr(cn_error_message(), says)) fail_msg("\"%s\" does not say \"%s\"", cn_error_message(), says);
    assert_non_null(strstr(cn_error_message(), path));
    assert_null(strchr(cn_error_message(), '\n'));
    assert_int_equal(scene.n_views, 0);
}

/* The scene is the truth after world = scale * turn * truth + move. */
static void same_poses(const cn_scene *scene, double scale, const double turn[9], const double move[3])
{
    assert_int_equal(scene->n_views, N);
    for (uint32_t i = 0; i < N; i++) {
        double back[9], rotation[9], was[3], want[3], have[3];
        assert_string_equal(scene->views[i].name, views[i].name);
        cn_mat3_transpose(turn, back);
        cn_mat3_mul(views[i].rotation, back, rotation);
        for (int k = 0; k < 9; k++)
            assert_true(fabs(scene->views[i].rotation[k] - rotation[k]) < 1e-9);
        cn_view_centre(&views[i], was);
        cn_mat3_vec(turn, was, want);
        cn_view_centre(&scene->views[i], have);
        for (int k = 0; k < 3; k++)
            assert_true(fabs(scale * want[k] + move[k] - have[k]) < 1e-7);
    }
}

static void same_lens(const cn_scene *scene)
{
    for (int p = 0; p < 25; p++) {
        const double at[3] = { 0.25 * (p % 5 - 2), 0.18 * (p / 5 - 2), 1.0 };
        double want[2], have[2];
        assert_true(cn_camera_project(&camera, at, want));
        assert_true(cn_camera_project(&scene->cameras[scene->views[0].camera], at, have));
        assert_true(hypot(want[0] - have[0], want[1] - have[1]) < 1e-6);
    }
}

/* ---- Metashape ---- */

static void say_numbers(const char *name, const double *v, int n)
{
    say("<%s>", name);
    for (int i = 0; i < n; i++)
        say("%s%.17g", i ? " " : "", v[i]);
    say("</%s>", name);
}

static void say_transform(double scale, const double turn[9], const double move[3])
{
    say("<transform>");
    say_numbers("rotation", turn, 9);
    say_numbers("translation", move, 3);
    say_numbers("scale", &scale, 1);
    say("</transform>\n");
}

/* Three cameras of component 0; one of another component, one that is not aligned, and one that is switched off. The
 * transform belongs to the component, or to the whole chunk. */
static void metashape(double scale, const double turn[9], const double move[3], bool of_component)
{
    static const char *const LABELS[N] = { "0", "1.png", "sub/2.jpg" };
    say("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<document version=\"1.5.0\">\n<chunk label=\"Chunk 1\" "
        "enabled=\"true\">\n<sensors next_id=\"1\"><sensor id=\"0\" label=\"cam\" type=\"frame\">"
        "<resolution width=\"%d\" height=\"%d\"/><property name=\"focal_length\" value=\"24\"/>"
        "<calibration type=\"frame\" class=\"adjusted\"><resolution width=\"%d\" "
        "height=\"%d\"/>\n<f>512</f><cx>6.4</cx>"
        "<cy>-12.8</cy><k1>0.04</k1><k2>-0.02</k2><p1>-0.002</p1><p2>0.001</p2><b1>5</b1></calibration></sensor>"
        "</sensors>\n",
        WIDTH, HEIGHT, WIDTH, HEIGHT);
    say("<components next_id=\"2\"><component id=\"0\" label=\"Component 1\">");
    if (of_component) say_transform(scale, turn, move);
    say("</component><component id=\"1\" label=\"Component 2\"/></components>\n<cameras next_id=\"6\">\n"
        "<camera id=\"7\" sensor_id=\"0\" component_id=\"1\" label=\"0.jpg\"><transform>1 0 0 5 0 1 0 5 0 0 1 5 0 0 0 "
        "1</transform></camera>\n");
    for (int i = 0; i < N; i++) {
        double m[16];
        world_from_cam(i, 1, m);
        say("<camera id=\"%d\" sensor_id=\"0\" component_id=\"0\" label=\"%s\">", i, LABELS[i]);
        say_numbers("transform", m, 16);
        say("<orientation>1</orientation><reference x=\"8\" y=\"47\" z=\"400\" enabled=\"true\"/></camera>\n");
    }
    say("<camera id=\"8\" sensor_id=\"0\" label=\"0.jpg\"/><camera id=\"9\" sensor_id=\"0\" component_id=\"0\" "
        "enabled=\"false\" label=\"0.jpg\"><transform>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</transform></camera>\n"
        "</cameras>\n");
    if (!of_component) say_transform(scale, turn, move);
    say("</chunk>\n</document>\n");
}

static void test_metashape(void **state)
{
    (void)state;
    static const double MOVE[3] = { 10, -20, 30 }, Q[4] = { 0.8, 0.1, -0.5, 0.3 };
    double turn[9];
    cn_quat_to_mat3(Q, turn);
    camera.params[0] = 517; /* f + b1 */
    for (int k = 0; k < 2; k++) {
        cn_scene scene;
        cn_import_origin origin;
        uint32_t n_models;
        begin("cameras.xml");
        metashape(2.5, turn, MOVE, k == 0);
        assert_int_equal(import(said, &scene, &n_models, &origin), CN_OK);
        assert_int_equal(n_models, 2);
        assert_false(origin.known);
        same_poses(&scene, 2.5, turn, MOVE);
        same_lens(&scene);
        cn_scene_deinit(&scene);
    }
}

/* A camera that was calibrated before has two calibrations. The adjusted one holds; the other one adds nothing to it.
 */
static void test_metashape_two_calibrations(void **state)
{
    (void)state;
    static const char INITIAL[] = "<calibration type=\"frame\" class=\"initial\"><resolution width=\"320\" "
                                  "height=\"240\"/><f>400</f><cx>9</cx><k3>0.3</k3><b2>90</b2></calibration>";
    static const double NONE[3] = { 0 };
    camera.params[0] = 517;
    for (int k = 0; k < 2; k++) {
        cn_scene scene;
        cn_import_origin origin;
        uint32_t n_models;
        begin("cameras.xml");
        metashape(1, SAME, NONE, true);
        const char *at = k ? "</calibration></sensor>" : "<calibration type=\"frame\" class=\"adjusted\">";
        char *both = k ? cn_format("</calibration>%s</sensor>", INITIAL) : cn_format("%s%s", INITIAL, at);
        assert_non_null(both);
        assert_int_equal(import(changed(at, both), &scene, &n_models, &origin), CN_OK);
        same_lens(&scene);
        free(both);
        cn_scene_deinit(&scene);
    }
}

/* A chunk in geocentric metres: 47.5 degrees north, 8.25 degrees east, 400 m above the ellipsoid. */
static void test_metashape_on_earth(void **state)
{
    (void)state;
    const double a = 47.5 * CN_PI / 180, b = 8.25 * CN_PI / 180, e2 = 0.00669437999014, none[3] = { 0 };
    const double normal = 6378137.0 / sqrt(1 - e2 * sin(a) * sin(a));
    const double place[3] = { (normal + 400) * cos(a) * cos(b), (normal + 400) * cos(a) * sin(b),
                              (normal * (1 - e2) + 400) * sin(a) };
    /* Columns: east, north, up. */
    const double turn[9] = { -sin(b), -sin(a) * cos(b), cos(a) * cos(b), cos(b), -sin(a) * sin(b), cos(a) * sin(b),
                             0,       cos(a),           sin(a) };
    cn_scene scene;
    cn_import_origin origin;
    uint32_t n_models;
    begin("cameras.xml");
    metashape(2, turn, place, false);
    assert_int_equal(import(said, &scene, &n_models, &origin), CN_OK);
    assert_true(origin.known && !origin.sea_level);
    assert_true(fabs(origin.latitude_deg - 47.5) < 1e-9 && fabs(origin.longitude_deg - 8.25) < 1e-9);
    assert_true(fabs(origin.height_m - 400) < 1e-4);
    same_poses(&scene, 2, SAME, none);
    cn_scene_deinit(&scene);
}

static void test_metashape_faults(void **state)
{
    (void)state;
    static const double NONE[3] = { 0 };
    begin("cameras.xml");
    metashape(1, SAME, NONE, true);
    refused("<?xml version=\"1.0\"?><kml></kml>", CN_ERR_FORMAT, "no cameras of Metashape");
    char *cut = strdup(said);
    cut[strlen(cut) / 2] = '\0';
    refused(cut, CN_ERR_FORMAT, "not valid XML");
    free(cut);
    refused(changed("sensor_id=\"0\" component_id=\"0\" label=\"0\"", "sensor_id=\"4\" component_id=\"0\" label=\"0\""),
            CN_ERR_FORMAT, "photo 0 names sensor 4, which does not exist");
    refused(changed("type=\"frame\"", "type=\"cylindrical\""), CN_ERR_FORMAT, "its sensor is of type cylindrical");
    refused(changed("<f>512</f>", ""), CN_ERR_FORMAT, "no calibration");
    refused(changed("<f>512</f>", "<f>5x</f>"), CN_ERR_FORMAT, "line 5: an element has more than its numbers");
    refused(changed("<b1>5</b1>", "<b2>40</b2>"), CN_ERR_FORMAT, "b2 shears the picture by 18.8 px");
    refused(changed("<scale>1</scale>", "<scale>0</scale>"), CN_ERR_FORMAT, "no scale above 0");
    refused(changed("label=\"1.png\"", "label=\"0.jpg\""), CN_ERR_FORMAT, "two frames name photo 0.jpg");
    refused("<document><chunk><cameras><camera id=\"0\" label=\"0\"/></cameras></chunk></document>", CN_ERR_FORMAT,
            "none of its 1 cameras is aligned");
    refused("<document><chunk><cameras><camera id=\"0\" label=\"0\"><transform>1 2 3</transform></camera></cameras>"
            "</chunk></document>",
            CN_ERR_FORMAT, "an element lacks a number");
}

/* ---- RealityCapture ---- */

static void say_row(const char *name, const double v[14])
{
    say("%s", name);
    for (int i = 0; i < 14; i++)
        say(",%.17g", v[i]);
    say(",0\r\n");
}

static void reality_capture(void)
{
    say("#cameras %d\r\n#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,t1,t2,k3,k4\r\n", N);
    for (int i = 0; i < N; i++) {
        double m[16];
        world_from_cam(i, -1, m);
        const double px = 36.0 / WIDTH, degrees = 180 / CN_PI;
        /* m = Rz(-heading) Rx(pitch) Ry(roll) */
        say_row(cn_path_base(views[i].name),
                (const double[14]){ m[3], m[7], m[11], atan2(m[1], m[5]) * degrees, asin(m[9]) * degrees,
                                    atan2(-m[8], m[10]) * degrees, 512 * px, 6.4 * px, -12.8 * px, 0.04, -0.02, 0.001,
                                    -0.002, 0 });
    }
}

static void test_reality_capture(void **state)
{
    (void)state;
    static const double NONE[3] = { 0 }, AWAY[3] = { -400, 300, 0 };
    cn_scene scene;
    cn_import_origin origin;
    uint32_t n_models;
    begin("cameras.csv");
    photos[2].name = views[2].name = photos[2].name + 4; /* its table has no folders */
    reality_capture();
    assert_int_equal(import(said, &scene, &n_models, &origin), CN_OK);
    same_poses(&scene, 1, SAME, NONE);
    same_lens(&scene);
    cn_scene_deinit(&scene);
    /* A camera at 0 that looks east, upright, in map coordinates. */
    begin("map.csv");
    say("#name,x,y,alt,heading,pitch,roll,f\n0.jpg,399600,5300300,7,90,90,0,30\n");
    assert_int_equal(import(said, &scene, &n_models, &origin), CN_OK);
    double centre[3];
    cn_view_centre(&scene.views[0], centre);
    assert_true(fabs(centre[0] - AWAY[0]) < 1e-6 && fabs(centre[1] - AWAY[1]) < 1e-6 && fabs(centre[2] - 7) < 1e-6);
    assert_true(fabs(scene.views[0].rotation[6] - 1) < 1e-9); /* the camera's z is the world's x */
    assert_true(fabs(scene.views[0].rotation[5] + 1) < 1e-9); /* and its y points down */
    cn_scene_deinit(&scene);
}

static void test_reality_capture_faults(void **state)
{
    (void)state;
    begin("cameras.csv");
    reality_capture();
    refused("#name,x,y,alt\n", CN_ERR_FORMAT, "line 1: no column \"heading\"");
    refused("#name,x,y,alt,heading,pitch,roll,f\n", CN_ERR_DATA, "none of its 0 frames");
    refused(changed("0.jpg,", "0.jpg,east"), CN_ERR_FORMAT, "line 3: x is \"east");
    refused(changed("1.png,", "0.jpg,"), CN_ERR_FORMAT, "two frames name photo 0.jpg");
    char *cut = strdup(said);
    cut[strlen(cut) - 30] = '\0';
    refused(cut, CN_ERR_FORMAT, "line 5: ");
    free(cut);
    refused("#name,x,y,alt,heading,pitch,roll,f\n0.jpg,0,0,0,0,0,0,0\n", CN_ERR_FORMAT, "focal length 0");
    refused("#name,x,y,alt,heading,pitch,roll,f\n,0,0,0,0,0,0,9\n", CN_ERR_FORMAT, "the name of the photo is missing");
    photos[0].has_gps = true;
    photos[0].longitude_deg = 8.25;
    photos[0].latitude_deg = 47.5;
    refused("#name,x,y,alt,heading,pitch,roll,f\n0.jpg,8.2501,47.4999,0,0,0,0,30\n", CN_ERR_FORMAT, "are degrees");
}

/* ---- Nerfstudio ---- */

/* Whether up may be anywhere in a file of Nerfstudio with these keys. */
static bool is_arbitrary(const char *of_file, const char *of_frame)
{
    cn_scene scene;
    cn_import_origin origin;
    uint32_t n_models;
    begin("transforms.json");
    say("{\"fl_x\": 500, %s\"frames\": [{%s\"file_path\": \"0.jpg\", \"transform_matrix\": [[1, 0, 0, 0], [0, 1, 0, "
        "0], "
        "[0, 0, 1, 0]]}]}",
        of_file, of_frame);
    assert_int_equal(import(said, &scene, &n_models, &origin), CN_OK);
    cn_scene_deinit(&scene);
    return origin.arbitrary_axes;
}

static void test_nerfstudio_axes(void **state)
{
    (void)state;
    assert_true(is_arbitrary("", "\"colmap_im_id\": 1, "));
    assert_true(is_arbitrary("\"applied_transform\": [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]], ", ""));
    assert_true(is_arbitrary("\"applied_transform\": [[0, 1, 0, 0], [1, 0, 0, 0], [-0.0, -0.0, -1.0, -0.0]], ", ""));
    assert_false(is_arbitrary("", ""));
    /* Of Metashape, which knows which way is down. */
    assert_false(is_arbitrary("\"applied_transform\": [[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0]], ", ""));
}

/* ---- Polycam and Record3D: y is up in their files, and z here ---- */

static const double ARKIT[9] = { 0, 0, 1, 1, 0, 0, 0, 1, 0 }, AT_ORIGIN[3] = { 0 };

static void write_keyframe(int i, const char *name)
{
    char file[64];
    double m[16];
    world_from_cam(i, -1, m);
    snprintf(file, sizeof file, "polycam/keyframes/corrected_cameras/%s.json", name);
    begin(file);
    say("{\"fx\": 512, \"fy\": 500, \"cx\": 322, \"cy\": 238, \"width\": %d, \"height\": %d, \"blur_score\": 90.1, "
        "\"timestamp\": %d",
        WIDTH, HEIGHT, i);
    for (int k = 0; k < 12; k++)
        say(", \"t_%d%d\": %.17g", k / 4, k % 4, m[k]);
    say("}");
    assert_int_equal(cn_folder_of_make(path), CN_OK);
    assert_int_equal(cn_file_write(path, said, strlen(said)), CN_OK);
}

static cn_status run_polycam(cn_scene *scene, cn_frame *frame)
{
    cn_pose_options options = cn_pose_options_default();
    cn_pose_report report;
    char project[128], work[128], frame_path[128];
    snprintf(project, sizeof project, "%s/polycam", folder);
    snprintf(work, sizeof work, "%s/poses", folder);
    snprintf(frame_path, sizeof frame_path, "%s/frame.json", folder);
    options.import = project;
    CN_TRY(cn_pose_run(NULL, &photo_index, work, frame_path, &options, &report));
    cn_pose_report_deinit(&report);
    CN_TRY(cn_frame_load(frame, frame_path));
    return cn_pose_load(NULL, work, &photo_index, scene);
}

static void test_polycam(void **state)
{
    (void)state;
    cn_scene scene;
    write_keyframe(0, "0");
    write_keyframe(1, "1");
    photos[2].name = views[2].name = photos[2].name + 4;
    write_keyframe(2, "2");
    camera = (cn_camera){ 1, CN_LENS_PINHOLE, WIDTH, HEIGHT, { 512, 500, 322, 238 } };
    cn_frame frame;
    const double none[3] = { 0 };
    assert_int_equal(run_polycam(&scene, &frame), CN_OK);
    same_poses(&scene, 1, ARKIT, none); /* a phone knows which way is down: its coordinates are kept */
    same_lens(&scene);
    cn_scene_deinit(&scene);
    assert_int_equal(cn_file_write(path, changed("\"t_11\"", "\"t_99\""), strlen(said)), CN_OK);
    assert_int_equal(run_polycam(&scene, &frame), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "t_11"));
    assert_non_null(strstr(cn_error_message(), "2.json"));
    assert_int_equal(cn_file_write(path, "{\"fx\": 5", 8), CN_OK);
    assert_int_equal(run_polycam(&scene, &frame), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "not valid JSON"));
}

static void record3d(void)
{
    say("{\"w\": %d, \"h\": %d, \"fps\": 60, \"K\": [512, 0, 0, 0, 500, 0, 322, 238, 1], \"poses\": [", WIDTH, HEIGHT);
    for (int i = 0; i < N; i++) {
        double m[16], rotation[9], q[4];
        world_from_cam(i, -1, m);
        for (int k = 0; k < 9; k++)
            rotation[k] = m[4 * (k / 3) + k % 3];
        cn_mat3_to_quat(rotation, q);
        say("%s[%.17g, %.17g, %.17g, %.17g, %.17g, %.17g, %.17g]", i ? ", " : "", q[1], q[2], q[3], q[0], m[3], m[7],
            m[11]);
    }
    say("]}");
}

static void test_record3d(void **state)
{
    (void)state;
    cn_scene scene;
    cn_import_origin origin;
    uint32_t n_models;
    begin("EXR_RGBD/metadata");
    photos[2].name = views[2].name = photos[2].name + 4;
    camera = (cn_camera){ 1, CN_LENS_PINHOLE, WIDTH, HEIGHT, { 512, 500, 322, 238 } };
    record3d();
    assert_int_equal(import(said, &scene, &n_models, &origin), CN_OK);
    same_poses(&scene, 1, ARKIT, AT_ORIGIN);
    same_lens(&scene);
    cn_scene_deinit(&scene);
    refused(changed("\"poses\": [[", "\"poses\": [[0, "), CN_ERR_FORMAT, "pose 0 is not the seven numbers");
    refused(changed("\"K\": [512, ", "\"K\": ["), CN_ERR_FORMAT, "\"K\"");
    refused(changed("\"poses\": [", "\"poses\": [[0, 0, 0, 3, 0, 0, 0], "), CN_ERR_FORMAT, "has not the length 1");
    refused(changed("]}", ""), CN_ERR_FORMAT, "not valid JSON");
    refused(changed("\"w\": 640", "\"w\": 0"), CN_ERR_FORMAT, "is no size in pixels");
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, photos_remove)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_metashape),
        TEST(test_metashape_two_calibrations),
        TEST(test_nerfstudio_axes),
        TEST(test_metashape_on_earth),
        TEST(test_metashape_faults),
        TEST(test_reality_capture),
        TEST(test_reality_capture_faults),
        TEST(test_polycam),
        TEST(test_record3d),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
