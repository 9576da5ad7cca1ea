#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/units.h"
#include "base/rng.h"
#include "conurb/pose.h"
#include "math/linalg.h"
#include "pose/align.h"
#include "pose/scene.h"
#include "pose/similarity.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { N = 24 };
static const double QUATERNION[4] = { 0.3, -0.5, 0.7, 0.2 };
static const double SCALE = 3.7, SHIFT[3] = { 12, -400, 31 };

static double uniform(uint64_t counter)
{
    return 2.0 * cn_rng_float(5, 6, counter) - 1.0;
}

static void test_similarity_with_outliers(void **state)
{
    (void)state;
    double source[N][3], target[N][3], r[9];
    cn_similarity similarity;
    bool inlier[N];
    cn_quat_to_mat3(QUATERNION, r);
    for (int i = 0; i < N; i++) {
        for (int k = 0; k < 3; k++)
            source[i][k] = 10.0 * uniform(3 * i + k);
        cn_mat3_vec(r, source[i], target[i]);
        for (int k = 0; k < 3; k++)
            target[i][k] = SCALE * target[i][k] + SHIFT[k];
        if (i % 3 == 0) target[i][i % 2] += 60.0 + i;
    }
    assert_int_equal(cn_pose_fit_similarity(&(cn_similarity_task){ N, source, target, 1.0, 1, 9 }, &similarity, inlier),
                     CN_OK);
    assert_true(fabs(similarity.scale - SCALE) < 1e-9);
    for (int i = 0; i < 9; i++)
        assert_true(fabs(similarity.rotation[i] - r[i]) < 1e-9);
    for (int k = 0; k < 3; k++)
        assert_true(fabs(similarity.translation[k] - SHIFT[k]) < 1e-8);
    for (int i = 0; i < N; i++)
        assert_int_equal(inlier[i], i % 3 != 0);
    assert_int_equal(cn_pose_fit_similarity(&(cn_similarity_task){ N, source, target, 1.0, 1, 9 }, &similarity, NULL),
                     CN_OK);
}

static void test_similarity_refused(void **state)
{
    (void)state;
    double source[N][3], line[N][3], place[N][3] = { { 0 } };
    cn_similarity similarity;
    for (int i = 0; i < N; i++)
        for (int k = 0; k < 3; k++) {
            source[i][k] = uniform(3 * i + k);
            line[i][k] = i * (k + 1.0);
        }
    assert_int_equal(cn_pose_fit_similarity(&(cn_similarity_task){ 2, source, source, 1, 1, 1 }, &similarity, NULL),
                     CN_ERR_DATA);
    assert_int_equal(cn_pose_fit_similarity(&(cn_similarity_task){ 0, source, source, 1, 1, 1 }, &similarity, NULL),
                     CN_ERR_DATA);
    assert_int_equal(cn_pose_fit_similarity(&(cn_similarity_task){ N, line, line, 1, 1, 1 }, &similarity, NULL),
                     CN_ERR_DATA);
    assert_int_equal(cn_pose_fit_similarity(&(cn_similarity_task){ N, source, line, 1, 1, 1 }, &similarity, NULL),
                     CN_ERR_DATA);
    assert_int_equal(cn_pose_fit_similarity(&(cn_similarity_task){ N, place, place, 1, 1, 1 }, &similarity, NULL),
                     CN_ERR_DATA);
    source[3][1] = NAN;
    assert_int_equal(cn_pose_fit_similarity(&(cn_similarity_task){ N, source, source, 1, 1, 1 }, &similarity, NULL),
                     CN_ERR_DATA);
}

/* Cameras in a known local frame, seen from a source frame that a similarity away; GPS from the truth. */
typedef struct city {
    cn_scene scene;
    cn_photo photos[N];
    cn_photo_index index;
    double truth[N][3];
    double up[3]; /* local z in the source frame */
} city;

typedef enum view_kind { STREET, SIDEWAYS, NADIR } view_kind;

static void aim(view_kind kind, double yaw, double r[9])
{
    double c = cos(yaw), s = sin(yaw);
    const double street[9] = { c, s, 0, 0, 0, -1, -s, c, 0 }; /* right, down, ahead; ahead is north at yaw 0 */
    const double nadir[9] = { c, s, 0, s, -c, 0, 0, 0, -1 };
    memcpy(r, kind == NADIR ? nadir : street, 9 * sizeof *r);
}

static void place_photo(city *c, int i, const double local[3])
{
    cn_frame frame;
    double at[3];
    cn_frame_init(&frame);
    frame.georeferenced = true;
    frame.latitude_deg = 10.0;
    frame.longitude_deg = 179.9999; /* the set crosses the antimeridian */
    frame.height_m = 50.0;
    assert_int_equal(cn_frame_to_geodetic(&frame, local, at), CN_OK);
    c->photos[i] = (cn_photo){ .name = c->scene.views[i].name,
                               .width = 100,
                               .height = 100,
                               .has_gps = true,
                               .latitude_deg = at[0],
                               .longitude_deg = at[1],
                               .has_altitude = true,
                               .altitude_m = at[2] };
}

static void make_city(city *c, view_kind kind, bool line, bool turning)
{
    memset(c, 0, sizeof *c);
    double source_from_local[9], r[9];
    cn_quat_to_mat3(QUATERNION, source_from_local);
    c->scene.views = calloc(N, sizeof *c->scene.views);
    c->scene.n_views = N;
    for (int i = 0; i < N; i++) {
        cn_view *view = &c->scene.views[i];
        double *local = c->truth[i], centre[3], moved[3];
        local[0] = line ? 0.0 : 30.0 * uniform(100 + i);
        local[1] = 6.0 * i;
        local[2] = line ? 0.0 : 4.0 * uniform(200 + i);
        view->name = malloc(8);
        view->name[0] = (char)('a' + i);
        view->name[1] = '\0';
        view->photo = (uint32_t)i;
        aim(kind, kind == SIDEWAYS ? 1.5707963 : turning ? 0.3 * i : 0.0, r);
        double inverse[9];
        cn_mat3_transpose(source_from_local, inverse);
        cn_mat3_mul(r, inverse, view->rotation);
        cn_mat3_vec(source_from_local, local, centre);
        for (int k = 0; k < 3; k++)
            centre[k] = centre[k] / SCALE + SHIFT[k];
        cn_mat3_vec(view->rotation, centre, moved);
        for (int k = 0; k < 3; k++)
            view->translation[k] = -moved[k];
        place_photo(c, i, local);
    }
    const double z[3] = { 0, 0, 1 };
    cn_mat3_vec(source_from_local, z, c->up);
    c->index = (cn_photo_index){ .photos = c->photos, .n_photos = N, .n_gps = N };
}

/* Camera centres where they were, up to the constant that the mean makes, and right side up. */
static void check_aligned(const city *c, double tolerance)
{
    double offset[3], centre[3];
    cn_view_centre(&c->scene.views[0], offset);
    for (int k = 0; k < 3; k++)
        offset[k] -= c->truth[0][k];
    for (int i = 0; i < N; i++) {
        cn_view_centre(&c->scene.views[i], centre);
        for (int k = 0; k < 3; k++)
            assert_true(fabs(centre[k] - offset[k] - c->truth[i][k]) < tolerance);
    }
}

static void check_kind(view_kind kind, bool line, bool turning)
{
    city c;
    cn_frame frame;
    double r[9];
    make_city(&c, kind, line, turning);
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    assert_true(frame.georeferenced);
    assert_int_equal(frame.n_inliers, N);
    assert_true(fabs(frame.scale - SCALE) < 1e-2);
    assert_true(frame.residual_horizontal_m < 0.02 && frame.residual_vertical_m < 0.02);
    check_aligned(&c, 0.05);
    aim(kind, kind == SIDEWAYS ? 1.5707963 : 0.0, r);
    for (int k = 0; k < 9; k++)
        assert_true(fabs(c.scene.views[0].rotation[k] - r[k]) < 0.01);
    assert_int_equal(frame.nadir_ambiguous, kind == NADIR);
    double back[3], centre[3];
    cn_view_centre(&c.scene.views[3], centre);
    assert_int_equal(cn_frame_to_geodetic(&frame, centre, back), CN_OK);
    assert_true(fabs(back[0] - c.photos[3].latitude_deg) < 1e-6);
    cn_scene_deinit(&c.scene);
}

static void test_area(void **state)
{
    (void)state;
    check_kind(STREET, false, true);
    check_kind(NADIR, false, true);
}

/* On a line the turn about it comes from how the cameras are held. */
static void test_lines(void **state)
{
    (void)state;
    check_kind(STREET, true, true);
    check_kind(STREET, true, false);
    check_kind(SIDEWAYS, true, false);
    check_kind(NADIR, true, true);
    check_kind(NADIR, true, false);
}

static void test_gps_outliers(void **state)
{
    (void)state;
    city c;
    cn_frame frame;
    make_city(&c, STREET, false, true);
    for (int i = 0; i < N; i += 4)
        c.photos[i].latitude_deg += 0.002 * (1 + i);
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    assert_int_equal(frame.n_inliers, N - N / 4);
    assert_int_equal(frame.n_gps, N);
    check_aligned(&c, 0.05);
    cn_scene_deinit(&c.scene);
}

/* Turns a view about its own centre, in its own axes. */
static void turn_view(cn_view *view, const double turn[9])
{
    double r[9], t[3];
    cn_mat3_mul(turn, view->rotation, r);
    cn_mat3_vec(turn, view->translation, t);
    memcpy(view->rotation, r, sizeof r);
    memcpy(view->translation, t, sizeof t);
}

/* How far the scene's up is from local z, in radians: that of photo i, which was level. */
static double tilt_of(const city *c, view_kind kind, int i)
{
    const double *r = c->scene.views[i].rotation;
    return acos(fmin(fmax(kind == NADIR ? -r[8] : -r[5], -1), 1));
}

/* A flight whose GPS is bad: heights rise by 110 m while the receiver warms up, and places are off by about 10 m. Those
 * of the photos whose errors fit a turned scene do not decide where up is. */
static void test_gps_that_drifts(void **state)
{
    (void)state;
    city c;
    cn_frame frame;
    double place_m = 0, centre[3], mean[3] = { 0 }, truth[3] = { 0 };
    make_city(&c, NADIR, false, true);
    for (int i = 0; i < N; i++) {
        const double off[3] = { 10 * uniform(400 + i), 10 * uniform(500 + i), 110.0 * i / N };
        double at[3];
        for (int k = 0; k < 3; k++)
            at[k] = c.truth[i][k] + off[k];
        place_photo(&c, i, at);
    }
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    assert_true(frame.georeferenced);
    assert_true(frame.n_inliers < 0.6 * N); /* the poses stay in doubt: import checks and attempts go by that */
    for (int i = 0; i < N; i++)
        assert_true(tilt_of(&c, NADIR, i) < 0.01);
    assert_true(fabs(frame.scale - SCALE) < 0.1 * SCALE);
    for (int i = 0; i < N; i++) {
        cn_view_centre(&c.scene.views[i], centre);
        for (int k = 0; k < 3; k++) {
            mean[k] += centre[k] / N;
            truth[k] += c.truth[i][k] / N;
        }
    }
    for (int i = 0; i < N; i++) {
        cn_view_centre(&c.scene.views[i], centre);
        for (int k = 0; k < 2; k++)
            place_m = fmax(place_m, fabs((centre[k] - mean[k]) - (c.truth[i][k] - truth[k])));
    }
    assert_true(place_m < 10);
    cn_scene_deinit(&c.scene);
}

/* Heights that are off by metres tilt a scene that is tens of metres wide. Cameras that are held level say more; where
 * heights are good, they decide, although the cameras are held askew. */
static void test_up_by_the_better(void **state)
{
    (void)state;
    for (int heights_are_good = 0; heights_are_good < 2; heights_are_good++) {
        city c;
        cn_frame frame;
        make_city(&c, STREET, false, true);
        for (int i = 0; i < N; i++) {
            const double roll = heights_are_good ? 0.1 * uniform(300 + i) + 0.05 : 0,
                         askew[9] = { cos(roll), sin(roll), 0, -sin(roll), cos(roll), 0, 0, 0, 1 };
            double at[3] = { c.truth[i][0], c.truth[i][1], c.truth[i][2] + (heights_are_good ? 0 : i / 4.0) };
            turn_view(&c.scene.views[i], askew);
            place_photo(&c, i, at);
        }
        assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
        assert_true(frame.georeferenced);
        if (heights_are_good)
            check_aligned(&c, 0.05);
        else
            for (int i = 0; i < N; i++)
                assert_true(tilt_of(&c, STREET, i) < 0.01);
        cn_scene_deinit(&c.scene);
    }
}

/* Where GPS is exact, a few photos that are held askew nearly alike do not outvote it. */
static void test_few_photos_held_askew(void **state)
{
    (void)state;
    enum { FEW = 8 };
    city c;
    cn_frame frame;
    bool keep[N] = { 0 };
    make_city(&c, STREET, false, true);
    for (int i = 0; i < FEW; i++) {
        const double roll = 0.035 + 0.015 * uniform(300 + i),
                     askew[9] = { cos(roll), sin(roll), 0, -sin(roll), cos(roll), 0, 0, 0, 1 };
        turn_view(&c.scene.views[i], askew);
        keep[i] = true;
    }
    assert_int_equal(cn_scene_keep_views(&c.scene, keep), CN_OK);
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    assert_int_equal(frame.n_inliers, FEW);
    assert_true(frame.residual_vertical_m < 0.001);
    cn_scene_deinit(&c.scene);
}

static char logged[2048];
static void note(void *user, cn_log_level level, const char *text)
{
    (void)user;
    if (level == CN_LOG_WARN) snprintf(logged + strlen(logged), sizeof logged - strlen(logged), "%s\n", text);
}

static void stays_local(city *c, const char *says)
{
    const cn_context ctx = { .log = note };
    cn_frame frame;
    double before[3], after[3];
    logged[0] = '\0';
    cn_view_centre(&c->scene.views[5], before);
    assert_int_equal(cn_align(&ctx, &c->scene, &c->index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    assert_false(frame.georeferenced);
    assert_true(frame.scale == 1.0 && frame.residual_horizontal_m == 0.0);
    assert_non_null(strstr(logged, says));
    /* It is only turned and moved, as the frame says. */
    cn_view_centre(&c->scene.views[5], after);
    for (int k = 0; k < 3; k++)
        assert_true(fabs(cn_dot3(frame.rotation + 3 * k, before) + frame.translation[k] - after[k]) < 1e-9);
    cn_scene_deinit(&c->scene);
}

static void test_no_georeference(void **state)
{
    (void)state;
    city c;
    make_city(&c, STREET, false, true);
    for (int i = 2; i < N; i++)
        c.photos[i].has_gps = false;
    stays_local(&c, "2 posed photos");
    make_city(&c, STREET, false, true);
    for (int i = 0; i < N; i++) {
        c.photos[i].latitude_deg = c.photos[0].latitude_deg;
        c.photos[i].longitude_deg = c.photos[0].longitude_deg;
        c.photos[i].altitude_m = 3.0;
    }
    stays_local(&c, "one place");
    make_city(&c, STREET, false, true);
    c.photos[3].latitude_deg = 95.0;
    stays_local(&c, "not a place on Earth");
    make_city(&c, STREET, false, true);
    for (int i = 0; i < N; i++)
        c.scene.views[i].photo = UINT32_MAX;
    stays_local(&c, "0 posed photos");
}

static void test_levelled_without_gps(void **state)
{
    (void)state;
    city c;
    cn_frame frame;
    double mean[3] = { 0 }, centre[3];
    make_city(&c, STREET, false, true);
    for (int i = 0; i < N; i++)
        c.photos[i].has_gps = false;
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_ALWAYS, &frame), CN_OK);
    assert_false(frame.georeferenced);
    for (int i = 0; i < N; i++) {
        assert_true(fabs(c.scene.views[i].rotation[5] + 1.0) < 1e-9); /* the pictures' down is -z */
        cn_view_centre(&c.scene.views[i], centre);
        for (int k = 0; k < 3; k++)
            mean[k] += centre[k] / N;
    }
    assert_true(fabs(mean[0]) < 1e-9 && fabs(mean[1]) < 1e-9 && fabs(mean[2]) < 1e-9);
    cn_scene_deinit(&c.scene);
}

/* A facade, photographed from about the same direction. One photo stands on its head, two on their sides, as photos do
 * whose EXIF is lost. */
static void test_levelled_with_turned_photos(void **state)
{
    (void)state;
    static const double turned[3][9] = { { -1, 0, 0, 0, -1, 0, 0, 0, 1 },
                                         { 0, 1, 0, -1, 0, 0, 0, 0, 1 },
                                         { 0, -1, 0, 1, 0, 0, 0, 0, 1 } };
    city c;
    cn_frame frame;
    make_city(&c, STREET, false, false);
    for (int i = 0; i < N; i++) {
        cn_view *view = &c.scene.views[i];
        const double a = 0.2 * uniform(300 + i), yaw[9] = { cos(a), 0, -sin(a), 0, 1, 0, sin(a), 0, cos(a) };
        const double *turn[2] = { yaw, i % 8 == 3 ? turned[i / 8] : NULL };
        for (int k = 0; k < 2 && turn[k]; k++)
            turn_view(view, turn[k]);
        c.photos[i].has_gps = false;
    }
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_ALWAYS, &frame), CN_OK);
    for (int i = 0; i < N; i++)
        if (i % 8 != 3) assert_true(fabs(c.scene.views[i].rotation[5] + 1.0) < 1e-9);
    assert_true(fabs(c.scene.views[3].rotation[5] - 1.0) < 1e-9);
    cn_scene_deinit(&c.scene);
}

/* Five photos of a front, from about the same direction, one of them tilted by 25 degrees. The tilt must not decide
 * where up is, nor must the others, where they are held a little askew. */
static void test_levelled_with_a_tilted_photo(void **state)
{
    (void)state;
    enum { FEW = 5, TILTED = 2 };
    static const double askew[] = { 0.01, 0.06 };
    for (int held = 0; held < 2; held++) {
        city c;
        cn_frame frame;
        make_city(&c, STREET, false, false);
        c.scene.n_views = FEW;
        for (int i = 0; i < FEW; i++) {
            const double a = 0.1 * (i - 2),
                         roll = i == TILTED ? 0.436
                                : i % 2     ? askew[held]
                                            : -askew[held],
                         yaw[9] = { cos(a), 0, -sin(a), 0, 1, 0, sin(a), 0, cos(a) },
                         tilt[9] = { cos(roll), sin(roll), 0, -sin(roll), cos(roll), 0, 0, 0, 1 };
            turn_view(&c.scene.views[i], yaw);
            turn_view(&c.scene.views[i], tilt);
            c.photos[i].has_gps = false;
        }
        assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_ALWAYS, &frame), CN_OK);
        for (int i = 0; i < FEW; i++)
            if (i != TILTED) assert_true(c.scene.views[i].rotation[5] < -0.99);
        assert_true(fabs(c.scene.views[TILTED].rotation[5] + cos(0.436)) < 0.1);
        c.scene.n_views = N;
        cn_scene_deinit(&c.scene);
    }
}

/* Puts points on a wall before the cameras, with a third of them elsewhere. flat: on the ground instead. */
static void add_wall(city *c, bool flat)
{
    enum { POINTS = 600 };
    double from[3];
    const double *r = c->scene.views[0].rotation;
    cn_view_centre(&c->scene.views[0], from);
    c->scene.points = realloc(c->scene.points, POINTS * sizeof *c->scene.points);
    c->scene.n_points = POINTS;
    for (uint32_t i = 0; i < POINTS; i++) {
        const double across = 30 * uniform(1000 + 3 * i), up = 10 * uniform(1001 + 3 * i),
                     depth = i % 3 == 0 ? 15 * uniform(1002 + 3 * i) : 0;
        cn_point *point = &c->scene.points[i];
        *point = (cn_point){ .n_observations = 3 };
        for (int k = 0; k < 3; k++)
            point->xyz[k] =
                from[k] + across * r[k] + (50 + (flat ? up : depth)) * r[6 + k] - (flat ? depth : up) * r[3 + k];
    }
}

/* A front, photographed from the street: all photos look up by 30 degrees, nearly one way. Without points they seem
 * level; a wall tells that they are not. The ground does not lean so far that it is taken for a wall. */
static void test_levelled_by_a_wall(void **state)
{
    (void)state;
    enum { WALL, NO_POINTS, GROUND };
    const double pitch = 30 * CN_PI / 180,
                 look_up[9] = { 1, 0, 0, 0, cos(pitch), sin(pitch), 0, -sin(pitch), cos(pitch) };
    for (int what = WALL; what <= GROUND; what++) {
        city c;
        cn_frame frame;
        make_city(&c, STREET, false, false);
        if (what == NO_POINTS)
            c.scene.n_points = 0;
        else
            add_wall(&c, what == GROUND);
        for (int i = 0; i < N; i++) {
            const double a = 0.02 * uniform(300 + i), yaw[9] = { cos(a), 0, -sin(a), 0, 1, 0, sin(a), 0, cos(a) };
            turn_view(&c.scene.views[i], yaw);
            if (what != GROUND) turn_view(&c.scene.views[i], look_up);
            c.photos[i].has_gps = false;
        }
        assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_ALWAYS, &frame), CN_OK);
        for (int i = 0; i < N; i++)
            assert_true(fabs(c.scene.views[i].rotation[8] - (what == WALL ? sin(pitch) : 0)) < 0.01);
        cn_scene_deinit(&c.scene);
    }
}

/* Imported poses of no particular axes are levelled too. Those whose z axis is up keep their coordinates, and so do
 * poses of a tool whose axes mean something. */
static void test_imported_without_gps(void **state)
{
    (void)state;
    city c;
    cn_frame frame;
    double before[3], after[3];
    const double tilt[9] = { 1, 0, 0, 0, 0.96592583, -0.25881905, 0, 0.25881905, 0.96592583 }; /* 15 degrees */
    const double none[3] = { 0 };
    make_city(&c, STREET, false, true);
    for (int i = 0; i < N; i++)
        c.photos[i].has_gps = false;
    cn_view_centre(&c.scene.views[5], before);
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_NEVER, &frame), CN_OK);
    cn_view_centre(&c.scene.views[5], after);
    assert_memory_equal(before, after, sizeof before);
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    for (int i = 0; i < N; i++)
        assert_true(fabs(c.scene.views[i].rotation[5] + 1.0) < 1e-9);
    cn_scene_transform(&c.scene, 1, tilt, none);
    cn_view_centre(&c.scene.views[5], before);
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    cn_view_centre(&c.scene.views[5], after);
    assert_memory_equal(before, after, sizeof before);
    cn_scene_deinit(&c.scene);
}

static void test_no_altitude(void **state)
{
    (void)state;
    city c;
    cn_frame frame;
    make_city(&c, STREET, false, true);
    for (int i = 0; i < N; i++)
        c.photos[i].has_altitude = false;
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_TILTED, &frame), CN_OK);
    assert_true(frame.georeferenced && !frame.geoid_applied);
    assert_true(fabs(frame.height_m) < 1e-9);
    /* The synthetic city's cameras are up to 4 m from one level. */
    assert_true(fabs(frame.scale - SCALE) < 0.001 * SCALE);
    assert_true(frame.residual_horizontal_m < 0.02 && frame.residual_vertical_m < 4.0);
    for (int i = 0; i < N; i++)
        assert_true(tilt_of(&c, STREET, i) < 0.01);
    cn_scene_deinit(&c.scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_similarity_with_outliers),
        cmocka_unit_test(test_similarity_refused),
        cmocka_unit_test(test_area),
        cmocka_unit_test(test_lines),
        cmocka_unit_test(test_gps_outliers),
        cmocka_unit_test(test_gps_that_drifts),
        cmocka_unit_test(test_up_by_the_better),
        cmocka_unit_test(test_few_photos_held_askew),
        cmocka_unit_test(test_no_georeference),
        cmocka_unit_test(test_levelled_without_gps),
        cmocka_unit_test(test_levelled_with_turned_photos),
        cmocka_unit_test(test_levelled_with_a_tilted_photo),
        cmocka_unit_test(test_levelled_by_a_wall),
        cmocka_unit_test(test_imported_without_gps),
        cmocka_unit_test(test_no_altitude),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
