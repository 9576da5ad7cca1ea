#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/units.h"
#include "conurb/path.h"
#include "math/linalg.h"

#include <math.h>
#include <string.h>

#define assert_near(value, want, tolerance) assert_true(fabs((double)(value) - (want)) <= (tolerance))
#define MAX_VIEWS 60

typedef struct synthetic {
    cn_scene scene;
    cn_camera camera;
    cn_view views[MAX_VIEWS];
} synthetic;

static void make(synthetic *m, uint32_t n)
{
    memset(m, 0, sizeof *m);
    m->camera = (cn_camera){ .lens = CN_LENS_PINHOLE, .width = 400, .height = 200, .params = { 999, 100, 200, 100 } };
    m->scene = (cn_scene){ .cameras = &m->camera, .n_cameras = 1, .views = m->views, .n_views = n };
}

/* A camera at c that looks straight down with the top of the picture to the north, or to the south. */
static void place(cn_view *view, double x, double y, double z, bool south)
{
    double s = south ? -1 : 1, r[9] = { s, 0, 0, 0, -s, 0, 0, 0, -1 }, c[3] = { x, y, z };
    memcpy(view->rotation, r, sizeof r);
    cn_mat3_vec(r, c, view->translation);
    for (int k = 0; k < 3; k++)
        view->translation[k] = -view->translation[k];
}

static void one_view_gives_frames_alike(void **state)
{
    (void)state;
    synthetic m;
    make(&m, 1);
    place(&m.views[0], 1, 2, 3, false);
    cn_path path;
    assert_int_equal(cn_path_default(&path, &m.scene, 5, 64, 32), CN_OK);
    assert_int_equal(path.n_frames, 5);
    for (uint32_t i = 0; i < 5; i++) {
        for (int k = 0; k < 9; k++)
            assert_near(path.frames[i].view.rotation[k], m.views[0].rotation[k], 1e-12);
        for (int k = 0; k < 3; k++)
            assert_near(path.frames[i].view.translation[k], m.views[0].translation[k], 1e-12);
        assert_near(path.frames[i].camera.params[1], 16, 1e-9); /* 90 degrees as the scene's camera */
    }
    cn_path_deinit(&path);
}

/* A photo on its side or head: the frames stand upright, and on the side they are as high as the photo is wide. */
static void frames_stand_upright(void **state)
{
    (void)state;
    static const double ahead[9] = { 1, 0, 0, 0, 0, -1, 0, 1, 0 };
    for (cn_side up = CN_SIDE_TOP; up <= CN_SIDE_BOTTOM; up++) {
        synthetic m;
        cn_path path;
        make(&m, 1);
        memcpy(m.views[0].rotation, ahead, sizeof ahead);
        cn_side_turn(up == CN_SIDE_LEFT    ? CN_SIDE_RIGHT /* and back */
                     : up == CN_SIDE_RIGHT ? CN_SIDE_LEFT
                                           : up,
                     m.views[0].rotation);
        assert_int_equal(cn_view_side_up(&m.views[0]), up);
        assert_int_equal(cn_path_default(&path, &m.scene, 1, 64, 32), CN_OK);
        for (int k = 0; k < 9; k++)
            assert_near(path.frames[0].view.rotation[k], ahead[k], 1e-12);
        const bool on_side = up == CN_SIDE_LEFT || up == CN_SIDE_RIGHT;
        assert_near(path.frames[0].camera.params[1], on_side ? 8 : 16, 1e-9);
        cn_path_deinit(&path);
    }
}

static void two_views_give_a_straight_even_line(void **state)
{
    (void)state;
    synthetic m;
    make(&m, 2);
    place(&m.views[0], 0, 0, 10, false);
    place(&m.views[1], 10, 0, 10, false);
    cn_path path;
    assert_int_equal(cn_path_default(&path, &m.scene, 11, 64, 32), CN_OK);
    for (uint32_t i = 0; i < 11; i++) {
        double c[3];
        cn_view_centre(&path.frames[i].view, c);
        assert_near(c[0], i, 0.02);
        assert_near(c[1], 0, 1e-9);
        assert_near(c[2], 10, 1e-9);
    }
    cn_path_deinit(&path);
}

/* Two rows of views that share no point, in turn by name, and one view in between that shares none at all. The flight
 * goes along one row, then along the other, and not from one to the other. */
static void parts_are_flown_one_after_the_other(void **state)
{
    (void)state;
    enum { N = 21, LONELY = 8 };
    synthetic m;
    cn_point points[2];
    cn_observation seen[N];
    cn_path path;
    make(&m, N);
    for (uint32_t i = 0; i < N; i++)
        place(&m.views[i], i / 2, i % 2 ? 1000 : 0, 10, false);
    m.scene.points = points;
    m.scene.observations = seen;
    for (uint32_t row = 0; row < 2; row++) {
        points[row] =
            (cn_point){ .xyz = { 5, 1000.0 * row, 0 }, .first_observation = (uint32_t)m.scene.n_observations };
        for (uint32_t i = row; i < N; i += 2)
            if (i != LONELY) seen[m.scene.n_observations++] = (cn_observation){ i, 200, 100 };
        points[row].n_observations = (uint32_t)m.scene.n_observations - points[row].first_observation;
    }
    m.scene.n_points = 2;
    assert_int_equal(cn_path_default(&path, &m.scene, 100, 64, 32), CN_OK);
    double before[3], c[3];
    uint32_t n_cuts = 0;
    cn_view_centre(&path.frames[0].view, before);
    for (uint32_t i = 0; i < 100; i++, memcpy(before, c, sizeof c)) {
        cn_view_centre(&path.frames[i].view, c);
        assert_true(fabs(c[1]) < 1e-6 || fabs(c[1] - 1000) < 1e-6);
        const bool cut = cn_distance3(before, c) > 500;
        assert_true(cut || cn_distance3(before, c) < 0.5);
        n_cuts += cut;
    }
    assert_int_equal(n_cuts, 1);
    assert_near(before[0], 9, 0.2);
    cn_path_deinit(&path);
}

/* 40 views round a place, and one or a group of three a hundred times as far away. One is not flown to; a group is a
 * place of its own. */
static void a_view_that_stands_alone_is_left_out(void **state)
{
    (void)state;
    enum { RING = 40 };
    for (uint32_t far = 0; far <= 3; far++) {
        synthetic m;
        cn_path path;
        double farthest = 0;
        make(&m, RING + far);
        for (uint32_t i = 0; i < RING + far; i++) {
            const double angle = 2 * CN_PI * i / RING;
            if (i >= 20 && i < 20 + far)
                place(&m.views[i], 2000 + 5 * i, 0, 60, false);
            else
                place(&m.views[i], 20 * cos(angle), 20 * sin(angle), 10, false);
        }
        assert_int_equal(cn_path_default(&path, &m.scene, 48, 64, 32), CN_OK);
        for (uint32_t f = 0; f < 48; f++) {
            double c[3];
            cn_view_centre(&path.frames[f].view, c);
            farthest = fmax(farthest, hypot(c[0], c[1]));
        }
        assert_true(far < 3 ? farthest < 20 + 1e-9 : farthest > 1000);
        cn_path_deinit(&path);
    }
}

/* Passes up and down, the camera turned about between them, as a survey drone flies. */
static void a_survey_stays_inside_and_smooth(void **state)
{
    (void)state;
    synthetic m;
    make(&m, 18);
    for (uint32_t i = 0; i < 18; i++) {
        uint32_t column = i / 6, row = column % 2 ? 5 - i % 6 : i % 6;
        place(&m.views[i], 50.0 * column, 20.0 * row, 60, column % 2);
    }
    cn_path path;
    assert_int_equal(cn_path_default(&path, &m.scene, 200, 64, 32), CN_OK);
    double before[3] = { 0 }, total = 0, longest = 0;
    for (uint32_t i = 0; i < 200; i++) {
        double c[3];
        cn_view_centre(&path.frames[i].view, c);
        assert_true(c[0] >= -1e-9 && c[0] <= 100 + 1e-9 && c[1] >= -1e-9 && c[1] <= 100 + 1e-9);
        assert_near(c[2], 60, 1e-9);
        const double *r = path.frames[i].view.rotation;
        assert_near(r[8], -1, 1e-6); /* always straight down: it turns about the vertical only */
        if (i > 0) {
            total += cn_distance3(before, c);
            longest = fmax(longest, cn_distance3(before, c));
            double turned = cn_dot3(r, path.frames[i - 1].view.rotation);
            assert_true(turned > cos(cn_radians(15)));
        }
        memcpy(before, c, sizeof c);
    }
    assert_true(total > 300); /* it visits all three columns */
    assert_true(longest < 1.05 * total / 199);
    cn_path_deinit(&path);
}

static void views_without_an_order_are_not_criss_crossed(void **state)
{
    (void)state;
    synthetic m;
    make(&m, 40);
    for (uint32_t i = 0; i < 40; i++)
        place(&m.views[i], i * 17 % 40, 0, 5, false);
    cn_path path;
    assert_int_equal(cn_path_default(&path, &m.scene, 100, 64, 32), CN_OK);
    double before[3], c[3], total = 0;
    cn_view_centre(&path.frames[0].view, before);
    for (uint32_t i = 1; i < 100; i++, memcpy(before, c, sizeof c)) {
        cn_view_centre(&path.frames[i].view, c);
        total += cn_distance3(before, c);
    }
    assert_true(total < 80); /* by name it would be some 300 */
    cn_path_deinit(&path);
}

/* A house of 10 m with sparse points on its walls, and eight views round it. By name they go from the west straight to
 * the east. inside: whether a frame is in the house. */
static void fly_round_a_house(bool with_points, bool *inside, double *longest)
{
    enum { PER_WALL = 400, POINTS = 4 * PER_WALL };
    static const int order[8] = { 4, 0, 1, 2, 3, 5, 6, 7 };
    static cn_point points[POINTS];
    static cn_observation observations[8 * POINTS];
    synthetic m;
    uint32_t n = 0;
    make(&m, 8);
    double at[8][3];
    for (uint32_t i = 0; i < 8; i++) {
        const double angle = cn_radians(45.0 * order[i]);
        const double c[3] = { 14 * cos(angle), 14 * sin(angle), 2 };
        memcpy(at[i], c, sizeof c);
        place(&m.views[i], c[0], c[1], c[2], false);
    }
    for (uint32_t i = 0; i < POINTS; i++) {
        const uint32_t wall = i / PER_WALL;
        const double angle = cn_radians(90.0 * wall), out[2] = { round(cos(angle)), round(sin(angle)) };
        const double along = (i % 20) / 2.0 - 4.75, up = (i % PER_WALL / 20) / 2.0 + 0.25;
        points[i] = (cn_point){ .xyz = { 5 * out[0] - along * out[1], 5 * out[1] + along * out[0], up },
                                .first_observation = n };
        for (uint32_t v = 0; v < 8; v++)
            if (at[v][0] * out[0] + at[v][1] * out[1] > 5) observations[n++].view = v;
        points[i].n_observations = n - points[i].first_observation;
    }
    if (with_points) {
        m.scene.points = points;
        m.scene.n_points = POINTS;
        m.scene.observations = observations;
        m.scene.n_observations = n;
    }
    cn_path path;
    assert_int_equal(cn_path_default(&path, &m.scene, 200, 64, 32), CN_OK);
    double before[3], c[3];
    *inside = false;
    *longest = 0;
    for (uint32_t i = 0; i < 200; i++, memcpy(before, c, sizeof c)) {
        cn_view_centre(&path.frames[i].view, c);
        *inside = *inside || (fabs(c[0]) < 5 && fabs(c[1]) < 5);
        if (i) *longest = fmax(*longest, cn_distance3(before, c));
    }
    cn_path_deinit(&path);
}

static void a_house_between_two_views_is_flown_round(void **state)
{
    (void)state;
    bool inside;
    double longest;
    fly_round_a_house(false, &inside, &longest);
    assert_true(inside); /* without points nothing is known of it */
    fly_round_a_house(true, &inside, &longest);
    assert_false(inside);
    assert_true(longest < 1); /* evenly: some 110 m in 200 frames */
}

/* Eight views in a row, whose photos show a wall 30 m away and a hedge of 4 m across the row, four from either side;
 * all show the top of a tower. No photo shows the ground at z = 0, which is nearer than all of that. */
static void a_hedge_between_two_views_is_flown_over(void **state)
{
    (void)state;
    enum { SHEET = 21 * 7, HEDGE = 7 * SHEET, POINTS = HEDGE + 24000 };
    static cn_point points[POINTS];
    static cn_observation observations[4 * POINTS + 4];
    uint32_t n = 0;
    synthetic m;
    make(&m, 8);
    for (uint32_t i = 0; i < 8; i++)
        place(&m.views[i], 0, i < 4 ? 3.0 * i : 3.0 * i + 7, 1.6, false);
    for (uint32_t i = 0; i < POINTS; i++) {
        const double hedge[3] = { 0.6 * (i % 21) - 6, 11 + i / SHEET, 0.6 * (i % SHEET / 21) + 0.2 },
                     wall[3] = { 30, 0.5 * (i % 100) - 10, 0.1 * (i / 100 % 240) }, tower[3] = { 30, 14, 40 };
        memcpy(points[i].xyz, i < HEDGE ? hedge : i < POINTS - 1 ? wall : tower, sizeof points[i].xyz);
        points[i].first_observation = n;
        for (uint32_t v = 0; v < 8; v++)
            if (i == POINTS - 1 || (v < 4) == (points[i].xyz[1] < 14)) observations[n++].view = v;
        points[i].n_observations = n - points[i].first_observation;
    }
    m.scene.points = points;
    m.scene.n_points = POINTS;
    m.scene.observations = observations;
    m.scene.n_observations = n;
    cn_path path;
    assert_int_equal(cn_path_default(&path, &m.scene, 200, 64, 32), CN_OK);
    double lowest = INFINITY, highest = 0;
    for (uint32_t i = 0; i < 200; i++) {
        double c[3];
        cn_view_centre(&path.frames[i].view, c);
        lowest = fmin(lowest, c[2]);
        highest = fmax(highest, c[2]);
    }
    assert_true(lowest > 0.5);
    assert_true(highest > 4);
    cn_path_deinit(&path);
}

static void nothing_to_fly_over_is_said(void **state)
{
    (void)state;
    synthetic m;
    make(&m, 0);
    cn_path path;
    assert_int_equal(cn_path_default(&path, &m.scene, 5, 64, 32), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "conurb poses"));
    assert_int_equal(cn_path_default(&path, &m.scene, 0, 64, 32), CN_ERR_USAGE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_view_gives_frames_alike),
        cmocka_unit_test(frames_stand_upright),
        cmocka_unit_test(two_views_give_a_straight_even_line),
        cmocka_unit_test(parts_are_flown_one_after_the_other),
        cmocka_unit_test(a_view_that_stands_alone_is_left_out),
        cmocka_unit_test(a_survey_stays_inside_and_smooth),
        cmocka_unit_test(views_without_an_order_are_not_criss_crossed),
        cmocka_unit_test(a_house_between_two_views_is_flown_round),
        cmocka_unit_test(a_hedge_between_two_views_is_flown_over),
        cmocka_unit_test(nothing_to_fly_over_is_said),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
