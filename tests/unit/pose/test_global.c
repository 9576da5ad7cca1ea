/* The global mapper on cameras and points that are known: each step alone, and all of it from a database. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../bridge/colmap_database.h"
#include "../common.h"
#include "bridge/ceres.h"
#include "fake_colmap.h"
#include "math/linalg.h"
#include "pose/global.h"
#include "pose/ladder.h"
#include "pose/view_graph.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { N = 12, POINTS = 300, WRONG = 4 /* of every 5 pairs, one */ };
#define FOCAL 600.0

static double centres[N][3], rotations[N][9], points[POINTS][3];
static float places[N][POINTS][2];
static cn_photo photos[N];
static char names[N][16], path[64], logged[LOGGED];
static const cn_photo_index photo_index = { .folder = "photos", .photos = photos, .n_photos = N };

static const cn_context CONTEXT = { .log = log_append, .user = logged };

/* The same numbers at each run. */
static double draw(void)
{
    static uint64_t state = 1;
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    return (double)(state >> 11) * 0x1p-53 * 2 - 1;
}

/* Cameras on an arc around a cloud of points, all of which they see. */
static int make_world(void **state)
{
    (void)state;
    for (int i = 0; i < POINTS; i++)
        for (int c = 0; c < 3; c++)
            points[i][c] = 2 * draw();
    for (int i = 0; i < N; i++) {
        const double angle = 0.22 * i;
        double *r = rotations[i], right[3], down[3], forward[3] = { -sin(angle), 0.3 * draw(), -cos(angle) };
        for (int c = 0; c < 3; c++)
            centres[i][c] = (c == 1 ? draw() : 9 * (c ? cos(angle) : sin(angle))) + 0.3 * draw();
        cn_normalize3(forward);
        cn_cross3(forward, (double[3]){ 0, 1, 0 }, right);
        cn_normalize3(right);
        cn_cross3(forward, right, down);
        memcpy(r, right, sizeof right);
        memcpy(r + 3, down, sizeof down);
        memcpy(r + 6, forward, sizeof forward);
        for (int k = 0; k < POINTS; k++) {
            double from[3], cam[3];
            for (int c = 0; c < 3; c++)
                from[c] = points[k][c] - centres[i][c];
            cn_mat3_vec(r, from, cam);
            places[i][k][0] = (float)(400 + FOCAL * cam[0] / cam[2] + 0.3 * draw());
            places[i][k][1] = (float)(300 + FOCAL * cam[1] / cam[2] + 0.3 * draw());
        }
        snprintf(names[i], sizeof names[i], "%02d.jpg", i);
        photos[i] = (cn_photo){ .name = names[i], .width = 800, .height = 600 };
    }
    return 0;
}

/* x_b = rotation * x_a + translation */
static void relative(int a, int b, double rotation[9], double translation[3])
{
    double back[9], between[3];
    cn_mat3_transpose(rotations[a], back);
    cn_mat3_mul(rotations[b], back, rotation);
    for (int c = 0; c < 3; c++)
        between[c] = centres[a][c] - centres[b][c];
    cn_mat3_vec(rotations[b], between, translation);
}

/* The matrix m of b' m a = 0 for pixels; essential: for rays. */
static void epipolar(int a, int b, bool essential, double m[9])
{
    double r[9], t[3], e[9], half[9];
    relative(a, b, r, t);
    const double cross[9] = { 0, -t[2], t[1], t[2], 0, -t[0], -t[1], t[0], 0 };
    cn_mat3_mul(cross, r, e);
    const double k[9] = { 1 / FOCAL, 0, -400 / FOCAL, 0, 1 / FOCAL, -300 / FOCAL, 0, 0, 1 };
    double kt[9];
    cn_mat3_transpose(k, kt);
    cn_mat3_mul(e, k, half);
    cn_mat3_mul(kt, half, m);
    if (essential) memcpy(m, e, sizeof e);
}

static double degrees_between(const double a[9], const double b[9])
{
    double back[9], turn[9];
    cn_mat3_transpose(a, back);
    cn_mat3_mul(back, b, turn);
    return acos(fmin(1, fmax(-1, 0.5 * (turn[0] + turn[4] + turn[8] - 1)))) * 57.29577951308232;
}

/* Pairs of cameras that are at most 5 apart. */
static void fill_graph(cn_view_graph *g, bool essential)
{
    *g = (cn_view_graph){ .n_views = N, .n_cameras = 1 };
    g->views = calloc(N, sizeof *g->views);
    g->pairs = calloc((size_t)N * N, sizeof *g->pairs);
    g->cameras = calloc(1, sizeof *g->cameras);
    g->knows_focal = calloc(1, sizeof *g->knows_focal);
    g->cameras[0] = (cn_camera){ 1, CN_LENS_OPENCV, 800, 600, { FOCAL, FOCAL, 400, 300 } };
    for (uint32_t i = 0; i < N; i++) {
        g->views[i] = (cn_graph_view){ .name = strdup(names[i]), .n = POINTS };
        g->views[i].xy = malloc(sizeof places[i]);
        memcpy(g->views[i].xy, places[i], sizeof places[i]);
    }
    for (uint32_t a = 0; a < N; a++)
        for (uint32_t b = a + 1; b < N && b <= a + 5; b++) {
            cn_graph_pair *pair = &g->pairs[g->n_pairs++];
            *pair = (cn_graph_pair){ .a = a, .b = b, .n = POINTS, .used = true, .is_essential = essential };
            pair->pairs = malloc(POINTS * sizeof *pair->pairs);
            for (uint32_t k = 0; k < POINTS; k++)
                pair->pairs[k][0] = pair->pairs[k][1] = k;
            epipolar((int)a, (int)b, essential, pair->matrix);
        }
}

/* Matrices give the relative poses, one of four; wrong matrices are refined to the right ones by the matches. */
static void pairs_are_related(void **state)
{
    (void)state;
    for (int essential = 0; essential < 2; essential++) {
        cn_view_graph g;
        fill_graph(&g, essential);
        for (uint32_t i = 0; i < g.n_pairs; i++)
            for (int k = 0; k < 9; k++)
                g.pairs[i].matrix[k] *= (essential ? 1 + 0.01 * draw() : 1) * (i % 2 ? -3 : 5);
        assert_int_equal(cn_graph_relate(NULL, &g), CN_OK);
        for (uint32_t i = 0; i < g.n_pairs; i++) {
            double r[9], t[3];
            relative((int)g.pairs[i].a, (int)g.pairs[i].b, r, t);
            cn_normalize3(t);
            assert_true(g.pairs[i].used);
            assert_true(degrees_between(r, g.pairs[i].rotation) < 0.3);
            assert_true(cn_dot3(t, g.pairs[i].translation) > cos(0.5 / 57.3));
        }
        cn_view_graph_deinit(&g);
    }
}

/* Matches of other points than the matrix is of lie behind the cameras as often as before them. */
static void a_wrong_pair_is_dropped(void **state)
{
    (void)state;
    cn_view_graph g;
    fill_graph(&g, true);
    for (uint32_t k = 0; k < POINTS; k++)
        g.pairs[3].pairs[k][1] = (k * 7 + 11) % POINTS;
    g.pairs[4].n = 10;
    memset(g.pairs[5].matrix, 0, sizeof g.pairs[5].matrix);
    assert_int_equal(cn_graph_relate(NULL, &g), CN_OK);
    assert_true(g.pairs[0].used && !g.pairs[4].used && !g.pairs[5].used);
    uint32_t n_placed;
    assert_int_equal(cn_graph_average(&g, &n_placed), CN_OK);
    assert_int_equal(n_placed, N);
    assert_false(g.pairs[3].used);
    cn_view_graph_deinit(&g);
}

/* Rotations of pairs half a degree off, and every fifth by a lot: the views' are right to half a degree, and the wrong
 * pairs are found. */
static void rotations_are_averaged(void **state)
{
    (void)state;
    cn_view_graph g;
    uint32_t n_placed;
    fill_graph(&g, true);
    for (uint32_t i = 0; i < g.n_pairs; i++) {
        double t[3], r[9];
        relative((int)g.pairs[i].a, (int)g.pairs[i].b, r, t);
        const double off = i % 5 == WRONG ? 0.7 : 0.004;
        const double q[4] = { 1, off * draw(), i % 2 ? off : -off, off * draw() };
        double turn[9];
        cn_quat_to_mat3(q, turn);
        cn_mat3_mul(turn, r, g.pairs[i].rotation);
    }
    assert_int_equal(cn_graph_average(&g, &n_placed), CN_OK);
    assert_int_equal(n_placed, N);
    for (uint32_t i = 0; i < g.n_pairs; i++) {
        double found[9], given[9], back[9], t[3];
        cn_mat3_transpose(g.views[g.pairs[i].a].rotation, back);
        cn_mat3_mul(g.views[g.pairs[i].b].rotation, back, found);
        relative((int)g.pairs[i].a, (int)g.pairs[i].b, given, t);
        assert_true(degrees_between(found, given) < 0.8);
        assert_true(g.pairs[i].used == (i % 5 != WRONG));
    }
    cn_view_graph_deinit(&g);
}

/* Views that nothing connects to the rest have no rotation. */
static void the_largest_part_is_placed(void **state)
{
    (void)state;
    cn_view_graph g;
    uint32_t n_placed;
    fill_graph(&g, true);
    assert_int_equal(cn_graph_relate(NULL, &g), CN_OK);
    for (uint32_t i = 0; i < g.n_pairs; i++)
        if (g.pairs[i].a < 4 && g.pairs[i].b >= 4) g.pairs[i].used = false;
    assert_int_equal(cn_graph_average(&g, &n_placed), CN_OK);
    assert_int_equal(n_placed, N - 4);
    for (int i = 0; i < N; i++)
        assert_true(g.views[i].placed == (i >= 4));
    cn_view_graph_deinit(&g);
}

static void a_focal_length_is_found(void **state)
{
    (void)state;
    cn_view_graph g;
    fill_graph(&g, false);
    g.cameras[0].params[0] = g.cameras[0].params[1] = 960;
    assert_true(cn_graph_calibrate(&g));
    assert_true(fabs(g.cameras[0].params[0] / FOCAL - 1) < 0.005);
    /* Essential matrices, and pairs of too few, say nothing of it. */
    for (uint32_t i = 4; i < g.n_pairs; i++)
        g.pairs[i].used = false;
    assert_false(cn_graph_calibrate(&g));
    for (uint32_t i = 0; i < g.n_pairs; i++)
        g.pairs[i].used = g.pairs[i].is_essential = true;
    assert_false(cn_graph_calibrate(&g));
    g.knows_focal[0] = true;
    assert_true(cn_graph_calibrate(&g));
    cn_view_graph_deinit(&g);
}

/* Directions alone place cameras and points from a start at random. */
static void directions_place_cameras(void **state)
{
    (void)state;
    static double found[N][3], found_points[POINTS][3];
    static cn_bearing bearings[N * POINTS];
    uint64_t n = 0;
    for (uint32_t i = 0; i < N; i++)
        for (uint32_t k = 0; k < POINTS; k++) {
            bearings[n] = (cn_bearing){ .centre = i, .point = k };
            for (int c = 0; c < 3; c++)
                bearings[n].direction[c] = points[k][c] - centres[i][c];
            cn_normalize3(bearings[n++].direction);
        }
    for (int i = 0; i < N * 3; i++)
        found[i / 3][i % 3] = draw();
    for (int i = 0; i < POINTS * 3; i++)
        found_points[i / 3][i % 3] = draw();
    const cn_bearings problem = { found, found_points, bearings, N, POINTS, n };
    cn_adjust_options options = cn_adjust_options_default();
    cn_adjust_result result;
    options.max_iterations = 300;
    assert_int_equal(cn_ceres_place(NULL, &problem, &options, &result), CN_OK);
    const double unit = cn_distance3(found[0], found[N - 1]) / cn_distance3(centres[0], centres[N - 1]);
    for (int i = 1; i < N; i++)
        assert_true(fabs(cn_distance3(found[0], found[i]) / unit - cn_distance3(centres[0], centres[i])) < 0.05);
    bearings[5].point = POINTS;
    assert_int_equal(cn_ceres_place(NULL, &problem, &options, &result), CN_ERR_DATA);
    bearings[5] = (cn_bearing){ .direction = { NAN, 0, 1 } };
    assert_int_equal(cn_ceres_place(NULL, &problem, &options, &result), CN_ERR_DATA);
    int stop = 1;
    const cn_context stopping = { .stop = &stop };
    bearings[5] = bearings[4];
    assert_int_equal(cn_ceres_place(&stopping, &problem, &options, &result), CN_ERR_INTERRUPTED);
}

/* ---- From a database ---- */

static void write_pair(int a, int b)
{
    static uint32_t same[POINTS][2];
    double f[9];
    for (uint32_t k = 0; k < POINTS; k++)
        same[k][0] = same[k][1] = k;
    epipolar(a, b, false, f);
    colmap_database_bind(path,
                         "INSERT INTO two_view_geometries(pair_id, rows, cols, data, config, F) "
                         "VALUES(?1, 300, 2, ?2, 3, ?3)",
                         (int64_t)(a + 1) * INT32_MAX + b + 1, same, sizeof same, f, sizeof f);
}

/* A database of all photos; one_camera: of one camera, whose focal length is not known. */
static void write_database(bool one_camera)
{
    strcpy(path, "/tmp/conurb-global-XXXXXX");
    const int file = mkstemp(path);
    assert_true(file >= 0);
    close(file);
    unlink(path);
    colmap_database_make(path);
    const double lens[8] = { 960, 960, 400, 300 };
    for (int i = 0; i < N; i++) {
        char image[256];
        if (i == 0 || !one_camera)
            colmap_database_bind(path,
                                 "INSERT INTO cameras(camera_id, model, width, height, params, prior_focal_length) "
                                 "VALUES(?1, 4, 800, 600, ?2, 0)",
                                 i + 1, lens, sizeof lens, NULL, 0);
        snprintf(image, sizeof image, "INSERT INTO images VALUES(%d, '%s', %d)", i + 1, names[i],
                 one_camera ? 1 : i + 1);
        colmap_database_run(path, image);
        colmap_database_bind(path, "INSERT INTO keypoints VALUES(?1, 300, 2, ?2)", i + 1, places[i], sizeof places[i],
                             NULL, 0);
        for (int b = i + 1; b < N && b <= i + 5; b++)
            write_pair(i, b);
    }
    logged[0] = '\0';
}

static cn_status map(cn_scene *scene)
{
    const cn_global_task task = { .ctx = &CONTEXT, .index = &photo_index, .database = path };
    return cn_global_map(&task, scene);
}

static void a_collection_is_mapped(void **state)
{
    (void)state;
    cn_scene scene, again;
    write_database(true);
    assert_int_equal(map(&scene), CN_OK);
    assert_int_equal(scene.n_views, N);
    assert_true(fabs(scene.cameras[0].params[0] / FOCAL - 1) < 0.005);
    double found[N][3];
    for (int i = 0; i < N; i++) {
        assert_string_equal(scene.views[i].name, names[i]);
        cn_view_centre(&scene.views[i], found[i]);
    }
    const double unit = cn_distance3(found[0], found[N - 1]) / cn_distance3(centres[0], centres[N - 1]);
    for (int a = 0; a < N; a++)
        for (int b = 0; b < a; b++)
            assert_true(fabs(cn_distance3(found[a], found[b]) / unit - cn_distance3(centres[a], centres[b])) < 0.03);
    /* On one thread the same bytes. */
    assert_int_equal(map(&again), CN_OK);
    assert_int_equal(again.n_points, scene.n_points);
    assert_memory_equal(again.points, scene.points, scene.n_points * sizeof *scene.points);
    cn_scene_deinit(&again);
    cn_scene_deinit(&scene);
    unlink(path);
}

/* What cannot be mapped at once is left to COLMAP, and the log says why. */
static void expect_refusal(const char *why)
{
    cn_scene scene;
    logged[0] = '\0';
    assert_int_equal(map(&scene), CN_OK);
    assert_int_equal(scene.n_views, 0);
    assert_non_null(strstr(logged, "mapped one after the other"));
    if (!strstr(logged, why)) fail_msg("%s: %s", why, logged);
}

static void what_does_not_hold_is_said(void **state)
{
    (void)state;
    write_database(false);
    expect_refusal("focal length");
    unlink(path);
    write_database(true);
    colmap_database_run(path, "UPDATE two_view_geometries SET rows = 299 WHERE pair_id % 2 = 0");
    expect_refusal("verified matches are damaged");
    colmap_database_run(path, "UPDATE two_view_geometries SET rows = 300");
    colmap_database_run(path, "UPDATE keypoints SET rows = 100, data = substr(data, 1, 800) WHERE image_id = 3");
    expect_refusal("a feature that is not there");
    colmap_database_run(path, "UPDATE keypoints SET rows = 101 WHERE image_id = 3");
    expect_refusal("keypoints of photo 3 are damaged");
    colmap_database_run(path, "DELETE FROM cameras");
    expect_refusal("camera 1 is missing");
    colmap_database_run(path, "DELETE FROM images");
    expect_refusal("none of the photos");
    colmap_database_run(path, "DROP TABLE cameras");
    colmap_database_run(path, "DROP TABLE images");
    expect_refusal("cannot be read");
    unlink(path);
}

static void few_pairs_are_refused(void **state)
{
    (void)state;
    write_database(true);
    colmap_database_run(path, "DELETE FROM two_view_geometries WHERE pair_id > 2147483647 + 4");
    colmap_database_run(path, "UPDATE cameras SET prior_focal_length = 1");
    expect_refusal("too few pairs");
    colmap_database_run(path, "UPDATE cameras SET prior_focal_length = 0");
    expect_refusal("focal length");
    unlink(path);
}

/* ---- With COLMAP, whose part a shell script plays ---- */

static char folder[64], program[96], work[96];

/* fails: words of a case of the script that then ends with 1; "": none. */
static void write_program(const char *fails)
{
    fake_colmap_write(
        program,
        "#!/bin/sh\necho \"$@\" >> %s/calls\n"
        "for a; do [ \"$b\" = --output_path ] && out=$a; [ \"$b\" = --input_path ] && in=$a; "
        "[ \"$b\" = --database_path ] && db=$a; b=$a; done\n"
        "case $1 in\n%s) echo 'ERROR: no memory'; exit 1;;\nfeature_extractor) cp %s $db;;\n"
        "point_triangulator|bundle_adjuster) cp $in/* $out;;\n"
        "mapper) if [ $in ]; then cp %s/whole/* $out; else cp -r %s/poses/sparse-global-placed $out/0; fi;;\nesac\n",
        folder, *fails ? fails : "none", path, folder, folder);
}

/* FOLDER/whole: a model of all photos. */
static void make_whole(void)
{
    cn_view views[N];
    cn_observation seen[N];
    cn_camera camera = { 1, CN_LENS_PINHOLE, 800, 600, { 960, 960, 400, 300 } };
    cn_point point = { .xyz = { 0, 0, 5 }, .n_observations = N };
    for (uint32_t i = 0; i < N; i++) {
        views[i] = (cn_view){ .name = names[i], .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
        seen[i] = (cn_observation){ i, 400, 300 };
    }
    const cn_scene scene = { &camera, 1, views, N, &point, 1, seen, N };
    char whole[96];
    snprintf(whole, sizeof whole, "%s/whole", folder);
    assert_int_equal(cn_scene_write_colmap(&scene, whole), CN_OK);
}

static size_t calls(const char *word)
{
    return file_count(folder, "calls", word);
}

static uint32_t attempts;

static cn_status pose(cn_mapper mapper, cn_colmap_result *result, cn_colmap_choice *choice)
{
    cn_pose_options options = cn_pose_options_default();
    options.match_with = CN_MATCH_WITH_COLMAP;
    options.colmap = program;
    options.mapper = mapper;
    options.attempts = attempts;
    const cn_colmap_task task = {
        .ctx = &CONTEXT, .index = &photo_index, .dir = work, .options = &options, .choice = choice
    };
    logged[0] = '\0';
    return cn_colmap_poses(&task, result);
}

static void begin(void)
{
    strcpy(folder, "/tmp/conurb-global-run-XXXXXX");
    assert_non_null(mkdtemp(folder));
    snprintf(program, sizeof program, "%s/colmap", folder);
    snprintf(work, sizeof work, "%s/poses", folder);
    assert_int_equal(mkdir(work, 0700), 0);
    write_database(true);
    attempts = 1;
}

static void end(void)
{
    unlink(path);
    assert_int_equal(folder_remove(folder), 0);
}

/* COLMAP is given the poses, and maps nothing itself; a second run does nothing again. */
static void colmap_goes_on(void **state)
{
    (void)state;
    begin();
    write_program("");
    for (int times = 0; times < 2; times++) {
        cn_colmap_choice choice = { 0 };
        cn_colmap_result result;
        assert_int_equal(pose(CN_MAP_AUTO, &result, &choice), CN_OK);
        assert_non_null(strstr(result.model, "/poses/sparse-global/0"));
        assert_int_equal(choice.attempt, 1);
        assert_string_equal(choice.way, "all photos at once");
        free(choice.database);
        cn_colmap_result_deinit(&result);
        assert_int_equal(calls("point_triangulator"), 1);
        assert_int_equal(calls("bundle_adjuster"), 1);
        assert_int_equal(calls("mapper --"), 0);
    }
    end();
}

/* A photo that was left out is COLMAP's to add. */
static void the_rest_is_added(void **state)
{
    (void)state;
    cn_colmap_result result;
    begin();
    colmap_database_run(path, "DELETE FROM two_view_geometries WHERE pair_id > 11 * 2147483647 OR pair_id % "
                              "2147483647 = 12");
    write_program("");
    make_whole();
    assert_int_equal(pose(CN_MAP_AUTO, &result, NULL), CN_OK);
    assert_int_equal(calls("mapper --"), 1);
    assert_int_equal(calls("sparse-global-adjusted\n"), 1); /* where the mapper begins */
    cn_colmap_result_deinit(&result);
    /* Then COLMAP also maps alone, once, and the result with more points is kept. */
    attempts = 5;
    assert_int_equal(pose(CN_MAP_AUTO, &result, NULL), CN_OK);
    assert_int_equal(calls("mapper --"), 2);
    assert_non_null(strstr(logged, "attempt 2 (COLMAP's defaults)"));
    assert_null(strstr(logged, "attempt 3"));
    cn_colmap_result_deinit(&result);
    end();
}

/* Where COLMAP cannot go on, or is asked to map alone, it maps one photo after the other. */
static void colmap_maps_alone(void **state)
{
    (void)state;
    cn_colmap_result result;
    begin();
    write_program("bundle_adjuster");
    assert_int_equal(pose(CN_MAP_AUTO, &result, NULL), CN_OK);
    assert_non_null(strstr(logged, "does not go on"));
    assert_non_null(strstr(result.model, "/poses/sparse/0"));
    cn_colmap_result_deinit(&result);
    assert_int_equal(calls("mapper --"), 1);
    write_program("");
    assert_int_equal(pose(CN_MAP_INCREMENTAL, &result, NULL), CN_OK);
    assert_null(strstr(logged, "at once"));
    assert_int_equal(calls("point_triangulator"), 1);
    cn_colmap_result_deinit(&result);
    end();
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pairs_are_related),       cmocka_unit_test(a_wrong_pair_is_dropped),
        cmocka_unit_test(rotations_are_averaged),  cmocka_unit_test(the_largest_part_is_placed),
        cmocka_unit_test(a_focal_length_is_found), cmocka_unit_test(directions_place_cameras),
        cmocka_unit_test(a_collection_is_mapped),  cmocka_unit_test(what_does_not_hold_is_said),
        cmocka_unit_test(few_pairs_are_refused),   cmocka_unit_test(colmap_goes_on),
        cmocka_unit_test(the_rest_is_added),       cmocka_unit_test(colmap_maps_alone),
    };
    return cmocka_run_group_tests(tests, make_world, NULL);
}
