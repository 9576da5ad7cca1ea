/* Control points: the three files that name them, and what they do to a scene whose GPS is 3 m off. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "base/rng.h"
#include "base/units.h"
#include "math/linalg.h"
#include "pose/align.h"
#include "pose/control_fit.h"
#include "pose/merge.h"
#include "pose/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { WIDTH = 640, HEIGHT = 480, N_VIEWS = 24, N_POINTS = 150, N_CONTROL = 9 };
static const double LATITUDE = 47.5, LONGITUDE = 8.25, UP = 450;

static char path[] = "/tmp/conurb-control-XXXXXX", logged[LOGGED], names[N_VIEWS][16];
static cn_photo photos[N_VIEWS];
static cn_photo_index photo_index;

static bool straight_down;

static const cn_context CONTEXT = { .log = log_append, .user = logged };

static int set_up(void **state)
{
    (void)state;
    static char folder[] = "/photos";
    for (int i = 0; i < N_VIEWS; i++) {
        snprintf(names[i], sizeof names[i], "%c.jpg", 'a' + i);
        photos[i] = (cn_photo){ .name = names[i], .width = WIDTH, .height = HEIGHT, .orientation = 1 };
    }
    photo_index = (cn_photo_index){ .folder = folder, .photos = photos, .n_photos = N_VIEWS };
    straight_down = false;
    logged[0] = '\0';
    strcpy(path + sizeof path - 7, "XXXXXX");
    const int fd = mkstemp(path);
    return fd < 0 ? -1 : close(fd);
}

static int tear_down(void **state)
{
    (void)state;
    return unlink(path);
}

static cn_status read_text(const char *text, const char *check, cn_control *control)
{
    const cn_control_source source = { &photo_index, path, check, false };
    assert_int_equal(cn_file_write(path, text, strlen(text)), CN_OK);
    return cn_control_read(&CONTEXT, &source, control);
}

/* ---- Files ---- */

static const char LIST[] = "WGS84 UTM 32N\n"
                           "# east north up, pixel, photo, name\n"
                           "691567.32638 5334734.33048 560.5 319.5 239.5 a.jpg P1\n"
                           "691567.32638 5334734.33048 560.5 99.5 49.5 b.jpg P1\n"
                           "691600.0 5334700.0 NaN 10 20 a.jpg P2 extra words\n";
static const char TABLE[] = "EPSG:32632\n"
                            "Label;Easting;Northing;Height;Image;px;py;sigma_xy;sigma_z;check\n"
                            "P1;691567.32638;5334734.33048;560.5;;;;0.01;0.03;\n"
                            "P1;;;;b.jpg;99.5;49.5;;;\n"
                            "\"P1\";;;; a.jpg ;319.5;239.5;;;\n"
                            "P2;691600;5334700;;folder/a.jpg;10;20;;;1\n";
static const char JSON[] =
    "{\"points\": [{\"id\": \"P1\", \"position\": {\"latitude\": 48.137, \"longitude\": 11.575, \"altitude\": 560.5},"
    "\"observations\": [{\"shot_id\": \"a.jpg\", \"projection\": [0, 0]}, {\"shot_id\": \"c.jpg\"},"
    "{\"shot_id\": \"b.jpg\", \"projection\": [-0.34375, -0.296875]}]},"
    "{\"id\": \"P2\", \"role\": \"metrics_only\", \"position\": {\"latitude\": 48.1366820, \"longitude\": 11.5754250},"
    "\"observations\": [{\"shot_id\": \"a.jpg\", \"projection\": [-0.48359375, -0.34296875]}]}]}";

static void same(const cn_control *c)
{
    assert_int_equal(c->n_points, 2);
    assert_int_equal(c->n_marks, 3);
    assert_string_equal(c->points[0].name, "P1");
    assert_true(fabs(c->points[0].place[0] - 48.137) < 1e-8 && fabs(c->points[0].place[1] - 11.575) < 1e-8);
    assert_true(c->points[0].place[2] == 560.5 && isnan(c->points[1].place[2]));
    assert_true(fabs(c->points[1].place[0] - 48.136682) < 1e-6);
    assert_int_equal(c->points[0].n_marks, 2);
    /* The centre of the first pixel is at 0.5, 0.5. */
    static const double want[3][4] = { { 0, 0, 320, 240 }, { 0, 1, 100, 50 }, { 1, 0, 10.5, 20.5 } };
    for (int i = 0; i < 3; i++) {
        assert_true(c->marks[i].point == want[i][0] && c->marks[i].photo == want[i][1]);
        assert_true(fabs(c->marks[i].x_px - want[i][2]) < 1e-9 && fabs(c->marks[i].y_px - want[i][3]) < 1e-9);
    }
}

static void test_files(void **state)
{
    (void)state;
    const char *const texts[] = { LIST, TABLE, JSON };
    for (int i = 0; i < 3; i++) {
        cn_control control;
        if (read_text(texts[i], NULL, &control) != CN_OK) fail_msg("%d: %s", i, cn_error_message());
        same(&control);
        assert_int_equal(control.points[1].check, i > 0);
        assert_true(control.points[0].sigma_m[0] == (i == 1 ? 0.01 : 0.0));
        assert_true(control.points[0].sigma_m[2] == (i == 1 ? 0.03 : 0.0));
        cn_control_deinit(&control);
        assert_int_equal(read_text(texts[i], " P1 ,P2", &control), CN_OK);
        assert_true(control.points[0].check && control.points[1].check);
        cn_control_deinit(&control);
    }
}

/* Pixels are those of the stored photo; a photo that is shown turned has its marks turned too. */
static void test_orientation(void **state)
{
    (void)state;
    cn_control control;
    photos[0] = (cn_photo){ .name = names[0], .width = HEIGHT, .height = WIDTH, .orientation = 6 };
    assert_int_equal(read_text(LIST, NULL, &control), CN_OK);
    /* Stored 10.5, 20.5 of 640 x 480; turned by a quarter clockwise the left edge becomes the upper one. */
    assert_true(control.marks[2].x_px == HEIGHT - 20.5 && control.marks[2].y_px == 10.5);
    cn_control_deinit(&control);
}

static void refused(const char *text, cn_status wanted, const char *says)
{
    cn_control control;
    assert_int_equal(read_text(text, strstr(text, "check P9") ? "P9" : NULL, &control), wanted);
    if (!strstr(cn_error_message(), says)) fail_msg("\"%s\" does not say \"%s\"", cn_error_message(), says);
    assert_non_null(strstr(cn_error_message(), path));
    assert_null(strchr(cn_error_message(), '\n'));
    assert_int_equal(control.n_points, 0);
}

static void test_faults(void **state)
{
    (void)state;
    static const char head[] = "EPSG:32632\nname,x,y,z,photo,px,py\n";
    char text[512];
    refused("", CN_ERR_FORMAT, "ends before a coordinate system");
    refused("1 2 3 4 5 a.jpg\n1 2 3 4 5 b.jpg\n", CN_ERR_FORMAT, "line 1 names no coordinate system");
    refused("EPSG:77\n1 2 3 4 5 a.jpg\n", CN_ERR_DATA, "EPSG:77");
    refused("WGS84\n11 48 500 4 5\n", CN_ERR_FORMAT, "line 2: x y z px py photo");
    refused("WGS84\n11 48 500 4 5 z.jpg\n", CN_ERR_DATA, "none of its marks is in a photo of /photos");
    assert_non_null(strstr(logged, "photo z.jpg is not in the collection"));
    refused("WGS84\n11 48 500 900 5 a.jpg P1\n", CN_ERR_FORMAT, "outside of photo a.jpg");
    refused("WGS84\n11 48 500 4 5 a.jpg P1\n11 48 500 9 9 a.jpg P1\n", CN_ERR_FORMAT, "marked twice in photo a.jpg");
    refused("WGS84\n11 48 500 4 5 a.jpg P1\n11 49 500 4 5 b.jpg P1\n", CN_ERR_FORMAT, "point P1 has two places");
    refused("WGS84\n11 48 500 4 5 a.jpg P1\n# check P9\n", CN_ERR_CONFIG, "has no point P9");
    refused("WGS84\n11 98 500 4 5 a.jpg P1\n", CN_ERR_DATA, "no place in");
    refused("EPSG:32632\nname,x,y,z,image\n", CN_ERR_FORMAT, "line 2 names no column px");
    snprintf(text, sizeof text, "%sP1,,,,a.jpg,4,5\n", head);
    refused(text, CN_ERR_FORMAT, "point P1 is marked, but its place is not stated");
    snprintf(text, sizeof text, "%sP1,600000,,400,a.jpg,4,5\n", head);
    refused(text, CN_ERR_FORMAT, "line 3: both x and y");
    snprintf(text, sizeof text, "%sP1,600000,5e6x,400,a.jpg,4,5\n", head);
    refused(text, CN_ERR_FORMAT, "line 3: y expected");
    snprintf(text, sizeof text, "%sP1,600000,5e6,400,a.jpg,4\n", head);
    refused(text, CN_ERR_FORMAT, "line 3: px and py");
    refused("{\"points\": [{\"id\": \"P1\"", CN_ERR_FORMAT, "not valid JSON");
    refused("{\"points\": [{\"id\": \"P1\"}]}", CN_ERR_FORMAT, "point 1: \"position\"");
    refused("{\"point\": []}", CN_ERR_FORMAT, "\"points\"");
}

/* ---- A scene ---- */

static cn_camera camera;
static cn_view views[N_VIEWS];
static cn_point points[N_POINTS];
static cn_observation seen[N_VIEWS * N_POINTS];
static cn_scene scene;
static cn_control control;
static cn_control_mark marks[N_VIEWS * N_CONTROL];
static cn_control_point control_points[N_CONTROL];
static char control_names[N_CONTROL][8];
static double truth[N_VIEWS][3];

static double chance(uint32_t i, uint32_t k)
{
    return 2.0 * cn_rng_float(11, i, k) - 1.0;
}

/* Nearly normal, with a standard deviation of 1. */
static double noise(uint32_t i, uint32_t k)
{
    double sum = 0;
    for (uint32_t j = 0; j < 3; j++)
        sum += chance(5000 + i, 3 * k + j);
    return sum;
}

static cn_frame earth(void)
{
    cn_frame frame;
    cn_frame_init(&frame);
    frame.georeferenced = true;
    frame.latitude_deg = LATITUDE;
    frame.longitude_deg = LONGITUDE;
    frame.height_m = UP;
    return frame;
}

static void geodetic(const double local[3], double place[3])
{
    const cn_frame frame = earth();
    assert_int_equal(cn_frame_to_geodetic(&frame, local, place), CN_OK);
}

/* A ring of 40 m that looks inwards and down; or a block that looks straight down. */
static void plant_view(uint32_t i, double gps_noise_m)
{
    const double turn = 2.0 * CN_PI * i / N_VIEWS;
    const double ring[3] = { 40 * cos(turn), 40 * sin(turn), 15 + 3 * (double)(i % 4) };
    const double block[3] = { 5.0 * (i % 6) - 12, 5.0 * (double)(i / 6) - 8, 40 + 0.3 * (i % 4) };
    const double *centre = straight_down ? block : ring;
    double z[3] = { -ring[0], -ring[1], -ring[2] }, up[3] = { 0, 0, 1 }, x[3], y[3], place[3], off[3], geoid_m;
    bool found;
    if (straight_down) {
        memcpy(z, (const double[3]){ 0, 0, -1 }, sizeof z);
        memcpy(up, (const double[3]){ 0, 1, 0 }, sizeof up);
    }
    cn_normalize3(z);
    cn_cross3(z, up, x);
    cn_normalize3(x);
    cn_cross3(z, x, y);
    views[i] = (cn_view){ .name = names[i], .photo = i };
    memcpy(views[i].rotation, x, sizeof x);
    memcpy(views[i].rotation + 3, y, sizeof y);
    memcpy(views[i].rotation + 6, z, sizeof z);
    cn_mat3_vec(views[i].rotation, centre, views[i].translation);
    for (uint32_t k = 0; k < 3; k++) {
        views[i].translation[k] = -views[i].translation[k];
        off[k] = centre[k] + gps_noise_m * noise(i, k);
    }
    memcpy(truth[i], centre, sizeof truth[i]);
    geodetic(off, place);
    assert_int_equal(cn_geo_geoid_height(place[0], place[1], &geoid_m, &found), CN_OK);
    photos[i].has_gps = photos[i].has_altitude = true;
    photos[i].latitude_deg = place[0];
    photos[i].longitude_deg = place[1];
    photos[i].altitude_m = place[2] - geoid_m;
}

static bool project(uint32_t i, const double xyz[3], double xy[2])
{
    double cam[3];
    cn_mat3_vec(views[i].rotation, xyz, cam);
    for (int k = 0; k < 3; k++)
        cam[k] += views[i].translation[k];
    return cn_camera_project(&camera, cam, xy);
}

static void plant_points(void)
{
    scene = (cn_scene){ &camera, 1, views, N_VIEWS, points, N_POINTS, seen, 0 };
    for (uint32_t p = 0; p < N_POINTS; p++) {
        points[p] = (cn_point){ .first_observation = (uint32_t)scene.n_observations };
        for (uint32_t k = 0; k < 3; k++)
            points[p].xyz[k] = (k == 2 ? straight_down ? 0.3 : 4 : 12) * chance(100 + p, k);
        for (uint32_t i = 0; i < N_VIEWS; i++) {
            double xy[2];
            assert_true(project(i, points[p].xyz, xy));
            const float off[2] = { (float)(0.3 * noise(i * N_POINTS + p, 0)),
                                   (float)(0.3 * noise(i * N_POINTS + p, 1)) };
            seen[scene.n_observations++] = (cn_observation){ i, (float)xy[0] + off[0], (float)xy[1] + off[1] };
        }
        points[p].n_observations = N_VIEWS;
    }
}

/* Points 0 to 4 are control points, the others check points. */
static void plant_control(void)
{
    control = (cn_control){ .points = control_points, .n_points = N_CONTROL, .marks = marks };
    for (uint32_t c = 0; c < N_CONTROL; c++) {
        double at[3] = { 11 * chance(900 + c, 0), 11 * chance(900 + c, 1), 3 * chance(900 + c, 2) }, xy[2];
        snprintf(control_names[c], sizeof control_names[c], "P%u", c);
        control_points[c] = (cn_control_point){ .name = control_names[c], .check = c >= 5 };
        geodetic(at, control_points[c].place);
        for (uint32_t i = 0; i < N_VIEWS; i += 2) {
            assert_true(project(i, at, xy));
            marks[control.n_marks++] =
                (cn_control_mark){ c, i, xy[0] + 0.3 * noise(c, 10 + i), xy[1] + 0.3 * noise(c, 60 + i) };
            control_points[c].n_marks++;
        }
    }
}

/* What the photos give: the truth in a frame of its own, bent by a lens whose focal length is 1 % off. */
static void plant(double gps_noise_m)
{
    const double turn[4] = { 0.8, 0.3, -0.4, 0.2 }, move[3] = { 4, -7, 2 };
    double whole[9];
    cn_quat_to_mat3(turn, whole);
    camera = (cn_camera){ 1, CN_LENS_SIMPLE_RADIAL, WIDTH, HEIGHT, { 600, 320, 240, -0.03 } };
    for (uint32_t i = 0; i < N_VIEWS; i++)
        plant_view(i, gps_noise_m);
    plant_points();
    plant_control();
    camera.params[0] *= 1.01;
    cn_scene_transform(&scene, 0.2, whole, move);
}

static double worst_centre(const cn_frame *frame)
{
    double worst = 0;
    for (uint32_t i = 0; i < N_VIEWS; i++) {
        double centre[3], place[3], local[3];
        const cn_frame true_frame = earth();
        cn_view_centre(&views[i], centre);
        assert_int_equal(cn_frame_to_geodetic(frame, centre, place), CN_OK);
        assert_int_equal(cn_frame_from_geodetic(&true_frame, place, local), CN_OK);
        worst = fmax(worst, cn_distance3(local, truth[i]));
    }
    return worst;
}

static double length(const double v[3])
{
    return cn_norm3(v);
}

static void test_control_points(void **state)
{
    (void)state;
    cn_frame frame;
    cn_control_fit fit;
    const cn_pose_options options = cn_pose_options_default();
    const cn_control_task task = { &control, &photo_index, &options };
    plant(3.0);
    assert_int_equal(cn_align(&CONTEXT, &scene, &photo_index, options.max_error_m, CN_LEVEL_ALWAYS, &frame), CN_OK);
    assert_true(frame.georeferenced && worst_centre(&frame) > 0.3);
    assert_int_equal(cn_control_apply(&CONTEXT, &task, &scene, &frame, &fit), CN_OK);
    assert_int_equal(fit.n_control, 5);
    assert_int_equal(fit.n_check, 4);
    assert_true(fit.adjusted && fit.georeferenced_before);
    if (!(length(fit.check_rms_m) < 0.03)) fail_msg("check points are %g m off", length(fit.check_rms_m));
    assert_true(length(fit.check_before_m) > 0.3 && worst_centre(&frame) < 0.15);
    assert_true(fabs(camera.params[0] - 600) < 1 && frame.n_inliers > 0);
    assert_non_null(strstr(logged, "4 check points: 0.0"));
    cn_control_fit_deinit(&fit);
}

/* Control points place a scene whose photos have no GPS at all; two are too few. */
static void test_without_gps(void **state)
{
    (void)state;
    cn_frame frame;
    cn_control_fit fit;
    const cn_pose_options options = cn_pose_options_default();
    const cn_control_task task = { &control, &photo_index, &options };
    plant(3.0);
    for (int i = 0; i < N_VIEWS; i++)
        photos[i].has_gps = false;
    assert_int_equal(cn_align(&CONTEXT, &scene, &photo_index, options.max_error_m, CN_LEVEL_ALWAYS, &frame), CN_OK);
    assert_false(frame.georeferenced);
    const cn_frame local = frame;
    assert_int_equal(cn_control_apply(&CONTEXT, &task, &scene, &frame, &fit), CN_OK);
    assert_true(frame.georeferenced && length(fit.check_rms_m) < 0.03 && worst_centre(&frame) < 0.15);
    assert_true(frame.geoid_applied == (frame.geoid_height_m != 0)); /* its heights are above the ellipsoid */
    assert_true(isnan(fit.check_before_m[0]));
    cn_control_fit_deinit(&fit);
    for (int c = 2; c < N_CONTROL; c++)
        control_points[c].check = true;
    frame = local;
    assert_int_equal(cn_control_apply(&CONTEXT, &task, &scene, &frame, &fit), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "2 control points are seen by two posed photos"));
}

/* A wrong place of one control point is named. */
static void test_blunder(void **state)
{
    (void)state;
    cn_frame frame;
    cn_control_fit fit;
    const cn_pose_options options = cn_pose_options_default();
    const cn_control_task task = { &control, &photo_index, &options };
    plant(3.0);
    control_points[3].place[2] += 2.0;
    assert_int_equal(cn_align(&CONTEXT, &scene, &photo_index, options.max_error_m, CN_LEVEL_ALWAYS, &frame), CN_OK);
    assert_int_equal(cn_control_apply(&CONTEXT, &task, &scene, &frame, &fit), CN_OK);
    assert_non_null(strstr(logged, "control point P3 is "));
    assert_null(strstr(logged, "control point P1 is "));
    assert_true(length(fit.check_rms_m) < 0.05);
    cn_control_fit_deinit(&fit);
}

/* Half of the photos have RTK of 2 cm, the others plain GPS of 3 m that states nothing. */
static void test_stated_accuracy(void **state)
{
    (void)state;
    cn_frame frame;
    cn_control_fit fit;
    const cn_pose_options options = cn_pose_options_default();
    const cn_control_task task = { NULL, &photo_index, &options };
    plant(0.02);
    for (uint32_t i = 0; i < N_VIEWS; i += 2)
        for (int k = 0; k < 3; k++)
            photos[i].gps_sigma_m[k] = 0.02;
    for (uint32_t i = 1; i < N_VIEWS; i += 2) {
        photos[i].latitude_deg += 2e-5 * noise(i, 80);
        photos[i].longitude_deg += 3e-5 * noise(i, 81);
        photos[i].altitude_m += 3 * noise(i, 82);
    }
    assert_true(cn_control_has_accurate_gps(&photo_index));
    assert_int_equal(cn_align(&CONTEXT, &scene, &photo_index, options.max_error_m, CN_LEVEL_ALWAYS, &frame), CN_OK);
    const double before = worst_centre(&frame);
    assert_int_equal(cn_control_apply(&CONTEXT, &task, &scene, &frame, &fit), CN_OK);
    if (!(before > 0.2 && worst_centre(&frame) < 0.06)) fail_msg("%g m, then %g m off", before, worst_centre(&frame));
    cn_control_fit_deinit(&fit);
}

typedef enum way { BY_GPS, BY_CONTROL, BY_GROUPS } way;

/* Focal length after an adjustment of photos that look straight down, of 606 px at first. */
static double focal_of(way how, cn_tristate refine_focal, double exif_mm)
{
    cn_frame frame;
    cn_control_fit fit = { 0 };
    cn_merge_report report = { 0 };
    cn_pose_options options = cn_pose_options_default();
    const cn_control_task task = { how == BY_CONTROL ? &control : NULL, &photo_index, &options };
    const cn_merge_task merge = { .index = &photo_index, .options = &options, .most_bytes = (size_t)1 << 30 };
    options.refine_focal = refine_focal;
    straight_down = true;
    plant(0.02);
    for (uint32_t i = 0; i < N_VIEWS; i++) {
        photos[i].focal_mm = exif_mm;
        photos[i].focal_35mm = NAN;
        for (int k = 0; k < 3; k++)
            photos[i].gps_sigma_m[k] = 0.02;
    }
    assert_int_equal(cn_align(&CONTEXT, &scene, &photo_index, options.max_error_m, CN_LEVEL_ALWAYS, &frame), CN_OK);
    assert_true(frame.georeferenced && frame.nadir_ambiguous);
    assert_int_equal(how == BY_GROUPS ? cn_groups_adjust(&CONTEXT, &merge, NULL, &scene, &frame, &report)
                                      : cn_control_apply(&CONTEXT, &task, &scene, &frame, &fit),
                     CN_OK);
    cn_control_fit_deinit(&fit);
    return camera.params[0];
}

/* Straight down, GPS says nothing of the focal length, so that it stays that of EXIF; control points do. */
static void test_straight_down(void **state)
{
    (void)state;
    for (way how = BY_GPS; how <= BY_GROUPS; how++) {
        assert_int_equal(focal_of(how, CN_AUTO, 3.6) == 606.0, how != BY_CONTROL);
        assert_true(focal_of(how, CN_AUTO, NAN) != 606.0);
        assert_true(focal_of(how, CN_ON, 3.6) != 606.0);
        assert_true(focal_of(how, CN_OFF, NAN) == 606.0);
    }
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = { TEST(test_files),           TEST(test_orientation),  TEST(test_faults),
                                        TEST(test_control_points),  TEST(test_without_gps),  TEST(test_blunder),
                                        TEST(test_stated_accuracy), TEST(test_straight_down) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
