/* Separate parts of a collection: which of COLMAP's other models GPS places, and where. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../bridge/colmap_database.h"
#include "../common.h"
#include "base/file.h"
#include "fake_colmap.h"
#include "math/linalg.h"
#include "pose/align.h"
#include "pose/from_photos.h"
#include "pose/parts.h"
#include "pose/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum { PARTS = 4, ROOM = 8, PHOTOS = PARTS * ROOM, POINTS = 20 };
#define RADIUS_M 15.0

/* Cameras on a circle look at points around its centre. Part 0 is the largest; 1 lies elsewhere, 2 beside it, 3 has few
 * photos. */
static const uint32_t SIZE[PARTS] = { 8, 6, 7, 3 };
static const double CENTRE[PARTS][2] = { { 0, 0 }, { 300, 40 }, { 45, 0 }, { -200, 0 } };

static char folder[64], names[PHOTOS][16];
static cn_photo photos[PHOTOS];
static cn_photo_index photo_index;
static cn_pose_options options;

static void place_of(uint32_t part, uint32_t i, double local[3])
{
    const double angle = 6.283185307179586 * i / SIZE[part];
    local[0] = CENTRE[part][0] + RADIUS_M * cos(angle);
    local[1] = CENTRE[part][1] + RADIUS_M * sin(angle);
    local[2] = 0.5 * (i % 3);
}

static void set_gps(uint32_t part, uint32_t i, const double local[3])
{
    double at[3];
    cn_frame frame;
    cn_photo *photo = &photos[part * ROOM + i];
    cn_frame_init(&frame);
    frame.georeferenced = true;
    frame.latitude_deg = 47;
    frame.longitude_deg = 8;
    frame.height_m = 400;
    assert_int_equal(cn_frame_to_geodetic(&frame, local, at), CN_OK);
    photo->has_gps = photo->has_altitude = true;
    photo->latitude_deg = at[0];
    photo->longitude_deg = at[1];
    photo->altitude_m = at[2];
}

/* The part in the local frame, or, with a turn, in a frame of its own. The caller frees it. */
static void make_scene(cn_scene *scene, uint32_t part, bool turned)
{
    const uint32_t n = SIZE[part];
    *scene = (cn_scene){ .cameras = calloc(1, sizeof *scene->cameras),
                         .n_cameras = 1,
                         .views = calloc(n, sizeof *scene->views),
                         .n_views = n,
                         .points = calloc(POINTS, sizeof *scene->points),
                         .n_points = POINTS,
                         .observations = calloc(POINTS * n, sizeof *scene->observations) };
    scene->cameras[0] = (cn_camera){ 1, CN_LENS_PINHOLE, 640, 480, { 500, 500, 320, 240 } };
    for (uint32_t i = 0; i < n; i++) {
        cn_view *view = &scene->views[i];
        double at[3], ahead[3], moved[3];
        place_of(part, i, at);
        *view = (cn_view){ .name = strdup(names[part * ROOM + i]), .photo = part * ROOM + i };
        for (int k = 0; k < 3; k++)
            ahead[k] = k < 2 ? (CENTRE[part][k] - at[k]) / RADIUS_M : 0;
        const double r[9] = { ahead[1], -ahead[0], 0, 0, 0, -1, ahead[0], ahead[1], 0 };
        memcpy(view->rotation, r, sizeof r);
        cn_mat3_vec(r, at, moved);
        for (int k = 0; k < 3; k++)
            view->translation[k] = -moved[k];
    }
    for (uint32_t p = 0; p < POINTS; p++) {
        cn_point *point = &scene->points[p];
        *point = (cn_point){ .xyz = { CENTRE[part][0] + 3 * sin(p), CENTRE[part][1] + 3 * cos(2 * p), 0.2 * p - 2 },
                             .first_observation = (uint32_t)scene->n_observations,
                             .n_observations = n };
        for (uint32_t i = 0; i < n; i++) {
            const cn_view *view = &scene->views[i];
            double at[3], px[2];
            cn_mat3_vec(view->rotation, point->xyz, at);
            for (int k = 0; k < 3; k++)
                at[k] += view->translation[k];
            assert_true(cn_camera_project(&scene->cameras[0], at, px));
            scene->observations[scene->n_observations++] = (cn_observation){ i, (float)px[0], (float)px[1] };
        }
    }
    double turn[9];
    const double quaternion[4] = { 0.5, 0.1 + 0.2 * part, -0.7, 0.3 }, shift[3] = { 5.0 * part, -3, 1 };
    cn_quat_to_mat3(quaternion, turn);
    if (turned) cn_scene_transform(scene, 0.4, turn, shift);
}

static int set_up(void **state)
{
    (void)state;
    strcpy(folder, "/tmp/conurb-parts-XXXXXX");
    if (!mkdtemp(folder)) return -1;
    photo_index = (cn_photo_index){ .folder = folder, .photos = photos, .n_photos = PHOTOS, .n_gps = PHOTOS };
    options = cn_pose_options_default();
    for (uint32_t i = 0; i < PHOTOS; i++) {
        snprintf(names[i], sizeof names[i], "%02u.jpg", (i * 7) % PHOTOS); /* parts alternate in order of names */
        photos[i] = (cn_photo){
            .name = names[i], .width = 640, .height = 480, .orientation = 1, .focal_mm = NAN, .focal_35mm = NAN
        };
    }
    for (uint32_t part = 0; part < PARTS; part++) {
        char path[96];
        cn_scene scene;
        double at[3];
        for (uint32_t i = 0; i < SIZE[part]; i++) {
            place_of(part, i, at);
            set_gps(part, i, at);
        }
        make_scene(&scene, part, true);
        snprintf(path, sizeof path, "%s/%u", folder, part);
        if (cn_scene_write_colmap(&scene, path) != CN_OK) return -1;
        cn_scene_deinit(&scene);
    }
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    return folder_remove(folder);
}

static void find(cn_colmap_task *task, cn_scene *main, cn_frame *frame, cn_parts *parts)
{
    make_scene(main, 0, true);
    for (uint32_t i = 0; i < main->n_views; i++)
        main->views[i].photo = i;
    assert_int_equal(cn_align(NULL, main, &photo_index, options.max_error_m, CN_LEVEL_ALWAYS, frame), CN_OK);
    assert_int_equal(cn_parts_find(task, folder, main, frame, parts), CN_OK);
}

/* Only the part elsewhere is taken, and it stands where its photos were taken. */
static void test_part_elsewhere(void **state)
{
    (void)state;
    cn_scene main;
    cn_frame frame;
    cn_parts parts;
    cn_colmap_task task = { .index = &photo_index, .options = &options };
    find(&task, &main, &frame, &parts);
    assert_true(frame.georeferenced);
    assert_int_equal(parts.n, 1);
    assert_int_equal(parts.n_views, SIZE[1]);
    double offset[3], first[3];
    place_of(0, 0, first);
    cn_view_centre(&main.views[0], offset);
    for (uint32_t i = 0; i < SIZE[1]; i++) {
        const cn_view *view = &parts.scenes[0].views[i];
        double at[3], true_at[3];
        assert_int_equal(view->photo / ROOM, 1);
        place_of(1, view->photo % ROOM, true_at);
        cn_view_centre(view, at);
        for (int k = 0; k < 3; k++)
            assert_true(fabs(at[k] - offset[k] + first[k] - true_at[k]) < 0.05);
    }
    cn_parts_deinit(&parts);
    cn_scene_deinit(&main);
}

/* A part whose photos have one GPS place for all has no place; nor have those of groups, of rigs, and without GPS. */
static void test_no_parts(void **state)
{
    (void)state;
    cn_scene main;
    cn_frame frame;
    cn_parts parts;
    bool core[PHOTOS] = { false };
    cn_colmap_task task = { .index = &photo_index, .options = &options, .core = core };
    find(&task, &main, &frame, &parts);
    assert_int_equal(parts.n, 0);
    cn_scene_deinit(&main);
    task.core = NULL;
    task.rig_views = true;
    find(&task, &main, &frame, &parts);
    assert_int_equal(parts.n, 0);
    cn_scene_deinit(&main);
    task.rig_views = false;
    const double one[3] = { CENTRE[1][0], CENTRE[1][1], 0 };
    for (uint32_t i = 0; i < SIZE[1]; i++)
        set_gps(1, i, one);
    find(&task, &main, &frame, &parts);
    assert_int_equal(parts.n, 0);
    cn_scene_deinit(&main);
    for (uint32_t i = 0; i < PHOTOS; i++)
        photos[i].has_gps = false;
    find(&task, &main, &frame, &parts);
    assert_int_equal(parts.n, 0);
    cn_scene_deinit(&main);
}

static double error_of(const cn_scene *scene)
{
    double most = 0, error;
    for (uint32_t p = 0; p < scene->n_points; p++)
        for (uint32_t i = 0; i < scene->points[p].n_observations; i++) {
            const cn_observation *seen = &scene->observations[scene->points[p].first_observation + i];
            assert_true(cn_scene_error(scene, &scene->points[p], seen, &error));
            most = fmax(most, error);
        }
    return most;
}

static char logged[LOGGED];

/* A shell script plays COLMAP, and gives all four models. */
static void write_program(const char *program)
{
    char made[96];
    snprintf(made, sizeof made, "%s/made.db", folder);
    colmap_database_make(made);
    fake_colmap_write(program,
                      "#!/bin/sh\nfor a; do [ \"$last\" = --output_path ] && out=$a; "
                      "[ \"$last\" = --database_path ] && [ ! -e $a ] && cp %s $a; last=$a; done\n"
                      "case $1 in mapper) cp -r %s/0 %s/1 %s/2 %s/3 $out;; esac\n",
                      made, folder, folder, folder, folder);
}

/* The poses of the photos have the part, and say so. */
static void test_from_photos(void **state)
{
    (void)state;
    char program[96], work[96];
    const cn_context context = { .log = log_append, .user = logged };
    cn_scene scene;
    cn_frame frame;
    uint32_t n_models;
    snprintf(program, sizeof program, "%s/colmap", folder);
    snprintf(work, sizeof work, "%s/poses", folder);
    write_program(program);
    assert_int_equal(mkdir(work, 0700), 0);
    options.colmap = program;
    options.match_with = CN_MATCH_WITH_COLMAP;
    options.mapper = CN_MAP_INCREMENTAL;
    options.attempts = 1;
    const cn_colmap_task task = { .ctx = &context, .index = &photo_index, .dir = work, .options = &options };
    assert_int_equal(cn_pose_from_photos(&task, &scene, &frame, &n_models), CN_OK);
    assert_int_equal(scene.n_views, SIZE[0] + SIZE[1]);
    assert_int_equal(scene.n_points, 2 * POINTS);
    assert_int_equal(n_models, 3);
    assert_true(error_of(&scene) < 0.01);
    assert_non_null(strstr(logged, "8 of 8 agree with their GPS, 6 more elsewhere by GPS"));
    assert_non_null(strstr(logged, "6 photos in 1 part that share no matches with the others are placed by their GPS"));
    cn_scene_deinit(&scene);
}

/* Two scenes become one, whose views are sorted by name and whose observations still fit. */
static void test_append(void **state)
{
    (void)state;
    cn_scene a, b;
    make_scene(&a, 0, false);
    make_scene(&b, 1, false);
    b.cameras[0].params[0] = 500.5; /* each keeps its camera */
    assert_int_equal(cn_scene_append(&a, &b), CN_OK);
    assert_int_equal(a.n_cameras, 2);
    assert_int_equal(a.n_views, SIZE[0] + SIZE[1]);
    assert_int_equal(a.n_points, 2 * POINTS);
    assert_int_equal(a.n_observations, POINTS * (SIZE[0] + SIZE[1]));
    for (uint32_t i = 0; i < a.n_views; i++) {
        assert_true(i == 0 || strcmp(a.views[i - 1].name, a.views[i].name) < 0);
        assert_int_equal(a.views[i].camera, a.views[i].photo / ROOM);
    }
    assert_true(error_of(&a) > 0.01 && error_of(&a) < 0.2);
    cn_scene_deinit(&a);
    cn_scene_deinit(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_part_elsewhere, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_no_parts, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_from_photos, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_append, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
