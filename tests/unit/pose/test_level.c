/* Up from how the photos were held, without GPS. */
#include "align_city.h"

#include "base/units.h"
#include "bridge/oiio.h"
#include "pose/scene.h"

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

static char folder[] = "/tmp/conurb-level-XXXXXX";

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

static const float SKY[3] = { 0.6f, 0.75f, 0.95f }, SEA[3] = { 0.2f, 0.35f, 0.55f };

/* Writes the photos to a folder: sky or sea on the left (as seen when they are stored) and ground on the right.
 * mirrored: the other way round. */
static void write_photos(city *c, const float sky[3], bool mirrored)
{
    enum { SIZE = 40 };
    static const float ground[3] = { 0.5f, 0.4f, 0.3f };
    static float rgb[SIZE * SIZE * 3];
    for (uint32_t i = 0; i < SIZE * SIZE; i++)
        memcpy(rgb + 3 * i, (i % SIZE < SIZE / 4) != mirrored ? sky : ground, sizeof ground);
    c->index.folder = folder;
    for (uint32_t i = 0; i < N; i++) {
        char path[512];
        snprintf(path, sizeof path, "%s/%c.png", folder, (char)('a' + i));
        assert_int_equal(cn_oiio_write_png(path, rgb, SIZE, SIZE, 3, NULL), CN_OK);
        free(c->scene.views[i].name);
        c->scene.views[i].name = malloc(8);
        snprintf(c->scene.views[i].name, 8, "%c.png", (char)('a' + i));
        c->photos[i].name = c->scene.views[i].name;
    }
}

/* From upright: with the left side up, and with the right side up. */
static const double LEFT_UP[9] = { 0, 1, 0, -1, 0, 0, 0, 0, 1 }, RIGHT_UP[9] = { 0, -1, 0, 1, 0, 0, 0, 0, 1 };

/* A walk around something with the camera on its side, tilted a little up and down. The sky tells which side is up;
 * without photos it is the left one, or the one by which they look down. One photo stands on its other side. */
static void test_levelled_on_the_side(void **state)
{
    (void)state;
    enum { LEFT, RIGHT, NO_PHOTOS, DOWN_BY_RIGHT, OTHER_SIDE = 7 };
    for (int what = LEFT; what <= DOWN_BY_RIGHT; what++) {
        const bool right_is_up = what == RIGHT || what == DOWN_BY_RIGHT;
        const double down = what == DOWN_BY_RIGHT ? 0.3 : 0;
        city c;
        cn_frame frame;
        make_city(&c, STREET, false, true);
        for (int i = 0; i < N; i++) {
            const double a = 0.2 * uniform(300 + i) - down,
                         pitch[9] = { 1, 0, 0, 0, cos(a), sin(a), 0, -sin(a), cos(a) };
            turn_view(&c.scene.views[i], pitch);
            turn_view(&c.scene.views[i], right_is_up != (i == OTHER_SIDE) ? RIGHT_UP : LEFT_UP);
            c.photos[i].has_gps = false;
        }
        if (what <= RIGHT) write_photos(&c, SKY, what == RIGHT);
        assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_ALWAYS, &frame), CN_OK);
        for (int i = 0; i < N; i++) {
            const double *r = c.scene.views[i].rotation, right = right_is_up != (i == OTHER_SIDE) ? 1 : -1;
            assert_true(fabs(r[5]) < 0.01);                     /* the pictures' down is level */
            assert_true(right * r[2] > cos(0.2 + down) - 0.01); /* their right or left is up */
        }
        cn_scene_deinit(&c.scene);
    }
}

/* A front, photographed nearly one way by a camera on its side: the cameras do not tell, but the sky does. A sea does
 * not, for what is bluer but darker may be beside what is photographed. */
static void test_levelled_by_the_sky(void **state)
{
    (void)state;
    enum { ON_SIDE, BESIDE_A_SEA, NO_PHOTOS };
    for (int what = ON_SIDE; what <= NO_PHOTOS; what++) {
        city c;
        cn_frame frame;
        make_city(&c, STREET, false, false);
        for (int i = 0; i < N; i++) {
            const double a = 0.2 * uniform(300 + i), yaw[9] = { cos(a), 0, -sin(a), 0, 1, 0, sin(a), 0, cos(a) };
            turn_view(&c.scene.views[i], yaw);
            turn_view(&c.scene.views[i], RIGHT_UP);
            c.photos[i].has_gps = false;
        }
        if (what != NO_PHOTOS) write_photos(&c, what == ON_SIDE ? SKY : SEA, true);
        assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_ALWAYS, &frame), CN_OK);
        for (int i = 0; i < N; i++) {
            const double *r = c.scene.views[i].rotation;
            assert_true(what == ON_SIDE ? r[2] > 0.99 : r[5] < -0.9);
        }
        cn_scene_deinit(&c.scene);
    }
}

/* A tower, photographed from below and from far, nearly one way: down axes differ more than right axes, but not as much
 * as of photos on their side. */
static void test_levelled_before_a_tower(void **state)
{
    (void)state;
    city c;
    cn_frame frame;
    make_city(&c, STREET, false, false);
    for (int i = 0; i < N; i++) {
        const double a = 0.4 * uniform(300 + i), pitch[9] = { 1, 0, 0, 0, cos(a), sin(a), 0, -sin(a), cos(a) },
                     b = 0.2 * uniform(400 + i), yaw[9] = { cos(b), 0, -sin(b), 0, 1, 0, sin(b), 0, cos(b) };
        turn_view(&c.scene.views[i], yaw);
        turn_view(&c.scene.views[i], pitch);
        c.photos[i].has_gps = false;
    }
    assert_int_equal(cn_align(NULL, &c.scene, &c.index, 5.0, CN_LEVEL_ALWAYS, &frame), CN_OK);
    for (int i = 0; i < N; i++)
        assert_true(c.scene.views[i].rotation[5] < -0.8); /* upright, but for the tilts */
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

static int make_folder(void **state)
{
    (void)state;
    return mkdtemp(folder) ? 0 : -1;
}

static int remove_folder(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < N; i++) {
        char path[512];
        snprintf(path, sizeof path, "%s/%c.png", folder, (char)('a' + i));
        unlink(path);
    }
    return rmdir(folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_levelled_without_gps),    cmocka_unit_test(test_levelled_with_turned_photos),
        cmocka_unit_test(test_levelled_on_the_side),    cmocka_unit_test(test_levelled_by_the_sky),
        cmocka_unit_test(test_levelled_before_a_tower), cmocka_unit_test(test_levelled_with_a_tilted_photo),
        cmocka_unit_test(test_levelled_by_a_wall),      cmocka_unit_test(test_imported_without_gps),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
