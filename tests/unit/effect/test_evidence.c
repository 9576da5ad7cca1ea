/* Evidence of sky and of transients from sparse points, on photos of a wall that the test draws: cameras on a line look
 * at a wall of squares, 20 m away, with sky above its roof. Before it stands a dark box, or people pass. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/file.h"
#include "base/rng.h"
#include "base/srgb.h"
#include "bridge/oiio.h"
#include "effect/effect.h"
#include "effect/sky_hints.h"
#include "effect/tracks.h"
#include "effect/vignetting.h"
#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 96, HEIGHT = 72, VIEWS = 24, ACROSS = 24, UP = 13, BOX = 50, POINTS = ACROSS * UP + BOX + 64 };
#define WALL_M 20.0
#define ROOF_M 8.0
#define BOX_M 10.0

/* What stands before the wall. STATUE: parked, too smooth for points of its own. TOWER: higher than the photos. CLOUD:
 * above the roof, with sky below. */
typedef enum before { NOTHING, PARKED, STATUE, PASSING, TOWER, CLOUD } before;

typedef enum sky_kind { NO_SKY, GREY_SKY, BLUE_SKY } sky_kind; /* a blue sky is darker than the wall */

typedef struct wall {
    cn_photo_index index;
    cn_scene scene;
    cn_camera camera;
    cn_view views[VIEWS];
    cn_point points[POINTS];
    cn_observation observations[POINTS * VIEWS];
    cn_pixel_store *pixels;
    cn_plan_tile tile;
    uint32_t photos[VIEWS];
    char folder[64];
    sky_kind sky;
    double falloff;    /* how much darker the corners are, stops */
    bool every_second; /* only in every second photo */
} wall;

static double step_m = 0.25;     /* between cameras */
static double thing_grey = 0.02; /* of what stands before the wall */
static bool first_on_its_head;   /* view 0 */
static unsigned border_px;       /* black, at the top and the bottom of photos */
/* West of WHITE_TO_M the wall is as bright as the sky below a dark edge of its roof; east of it is sky. */
static bool white_wall;
#define WHITE_TO_M 4.0
static double camera_x(unsigned view)
{
    return step_m * (view - VIEWS / 2.0);
}

/* The dark thing's middle, as far as BOX_M away. */
static double thing_x(before what, unsigned view)
{
    return what == PASSING ? fmod(view * 1.7, 6) - 3 : 0;
}

static bool in_thing(before what, unsigned view, const double origin[3], const double dir[3])
{
    if (what == NOTHING) return false;
    const double t = BOX_M / dir[1], x = origin[0] + t * dir[0] - thing_x(what, view), z = origin[2] + t * dir[2];
    return fabs(x) < 1 && z > (what == CLOUD ? 5.8 : -2) && z < (what == TOWER || what == CLOUD ? 100 : 3.5);
}

static void colour(const wall *w, before what, unsigned view, const double dir[3], double rgb[3])
{
    static const double tint[3][3] = { { 1, 1, 1 }, { 1, 1, 1 }, { 0.02, 0.06, 0.3 } };
    const double origin[3] = { camera_x(view), 0, 2 }, t = WALL_M / dir[1];
    const double x = origin[0] + t * dir[0], z = origin[2] + t * dir[2];
    if (white_wall && x < WHITE_TO_M && fabs(z - ROOF_M + 0.25) < 0.25) return (void)memset(rgb, 0, 3 * sizeof *rgb);
    const bool thing = in_thing(what, view, origin, dir), above = !thing && w->sky && z > ROOF_M;
    /* Brighter to the east: photos of the same bytes would be left out. */
    const double squares = (((int)floor(x) + (int)floor(z)) & 1 ? 0.15 : 0.3) * (1 + 0.01 * x);
    const double grey = thing ? thing_grey : above ? 0.6 + 0.004 * (z - ROOF_M) : white_wall ? 0.6 : squares;
    for (int c = 0; c < 3; c++)
        rgb[c] = grey * tint[above ? w->sky : NO_SKY][c];
}

static void draw(wall *w, before what, unsigned view)
{
    static float rgb[3 * WIDTH * HEIGHT];
    for (unsigned i = 0; i < WIDTH * HEIGHT; i++) {
        double in_camera[3], dir[3], seen[3];
        assert_int_equal(cn_camera_unproject(&w->camera, i % WIDTH + 0.5, i / WIDTH + 0.5, in_camera), CN_OK);
        cn_mat3_tvec(w->views[view].rotation, in_camera, dir);
        colour(w, what, view, dir, seen);
        if (i / WIDTH < border_px || i / WIDTH >= HEIGHT - border_px) memset(seen, 0, sizeof seen);
        const double falloff = w->every_second && view % 2 ? 0 : w->falloff;
        const double lens = exp2(-falloff * cn_track_square(i % WIDTH + 0.5, i / WIDTH + 0.5, WIDTH, HEIGHT));
        for (int c = 0; c < 3; c++)
            rgb[3 * i + (unsigned)c] = (float)pow(lens * seen[c], 1 / 2.2);
    }
    char *path = cn_path_join(w->folder, w->views[view].name);
    assert_int_equal(cn_oiio_write_png(path, rgb, WIDTH, HEIGHT, 3, NULL), CN_OK);
    free(path);
}

/* Adds a point, with an observation in each view that shows it. */
static void add_point(wall *w, before what, const double xyz[3], bool of_thing)
{
    cn_point *p = &w->points[w->scene.n_points];
    *p = (cn_point){ .xyz = { xyz[0], xyz[1], xyz[2] }, .first_observation = (uint32_t)w->scene.n_observations };
    for (unsigned v = 0; v < VIEWS; v++) {
        double cam[3], xy[2], dir[3];
        const double origin[3] = { camera_x(v), 0, 2 };
        cn_mat3_vec(w->views[v].rotation, xyz, cam);
        for (int a = 0; a < 3; a++) {
            cam[a] += w->views[v].translation[a];
            dir[a] = xyz[a] - origin[a];
        }
        if (!cn_camera_project(&w->camera, cam, xy) || xy[0] < 0 || xy[1] < 0 || xy[0] >= WIDTH || xy[1] >= HEIGHT)
            continue;
        if (!of_thing && in_thing(what, v, origin, dir)) continue;
        w->observations[w->scene.n_observations++] = (cn_observation){ v, (float)xy[0], (float)xy[1] };
        p->n_observations++;
    }
    w->scene.n_points++;
}

static void wall_init_through(wall *w, before what, sky_kind sky, double falloff, bool every_second)
{
    memset(w, 0, sizeof *w);
    w->sky = sky;
    w->falloff = falloff;
    w->every_second = every_second;
    strcpy(w->folder, "/tmp/conurb-wall-XXXXXX");
    assert_non_null(mkdtemp(w->folder));
    w->camera = (cn_camera){ .lens = CN_LENS_PINHOLE, .width = WIDTH, .height = HEIGHT, .params = { 80, 80, 48, 36 } };
    w->scene = (cn_scene){ .cameras = &w->camera,
                           .n_cameras = 1,
                           .views = w->views,
                           .n_views = VIEWS,
                           .points = w->points,
                           .observations = w->observations };
    for (unsigned v = 0; v < VIEWS; v++) {
        w->views[v] = (cn_view){ .name = cn_format("%02u.png", v),
                                 .photo = v,
                                 .rotation = { 1, 0, 0, 0, 0, -1, 0, 1, 0 },
                                 .translation = { -camera_x(v), 2, 0 } };
        for (int a = 0; v == 0 && first_on_its_head && a < 6; a++) {
            w->views[v].rotation[a] *= -1;
            w->views[v].translation[a % 2] *= a < 2 ? -1 : 1;
        }
        w->photos[v] = v;
        draw(w, what, v);
    }
    for (int i = 0; i < ACROSS * UP; i++)
        add_point(w, what, (double[3]){ i % ACROSS - ACROSS / 2 + 0.5, WALL_M, i / ACROSS - 5 + 0.5 }, false);
    for (int i = 0; what == PARKED && i < BOX; i++)
        add_point(w, what, (double[3]){ i % 5 * 0.45 - 0.9, BOX_M, i / 5 * 0.55 - 1.8 }, true);
    w->tile = (cn_plan_tile){ .id = "wall", .photos = w->photos, .n_photos = VIEWS };
    const cn_context quiet = { 0 };
    char *store = cn_path_join(w->folder, "pixels.bin");
    assert_int_equal(cn_photo_index_scan(&quiet, w->folder, &w->index), CN_OK);
    assert_int_equal(cn_pixel_store_build(&quiet, &w->index, WIDTH, store), CN_OK);
    assert_int_equal(cn_pixel_store_open(&w->pixels, store), CN_OK);
    free(store);
}

static void wall_init(wall *w, before what, sky_kind sky)
{
    wall_init_through(w, what, sky, 0, false);
}

static void wall_deinit(wall *w)
{
    cn_pixel_store_close(&w->pixels);
    cn_photo_index_deinit(&w->index);
    for (unsigned v = 0; v < VIEWS; v++)
        free(w->views[v].name);
    char *command = cn_format("rm -rf %s", w->folder);
    assert_int_equal(system(command), 0);
    free(command);
}

typedef double (*measure)(const cn_plan_input *input, const cn_plan_tile *tile);

static double evidence(measure of, before what, sky_kind sky)
{
    static wall w;
    wall_init(&w, what, sky);
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    const double value = of(&input, &w.tile);
    wall_deinit(&w);
    return value;
}

/* The roof is at row 12 of 72: a sixth of each photo is sky. Points stand along the roof's edge. */
static void test_sky(void **state)
{
    (void)state;
    const double blue = evidence(cn_sky_hints_share, NOTHING, BLUE_SKY);
    const double with = evidence(cn_sky_hints_share, NOTHING, GREY_SKY),
                 without = evidence(cn_sky_hints_share, NOTHING, NO_SKY);
    assert_true(with > 0.14 && with < 0.18);
    assert_true(blue > 0.14 && blue < 0.18);
    assert_true(without < 0.02);
}

/* The sky is known up to two hints from the roof, although sparse points stand on the roof's edge. Below the points of
 * a column no hint tells of sky. */
static void test_sky_hints(void **state)
{
    (void)state;
    static wall w;
    static uint8_t hint[VIEWS * CN_SKY_HINTS];
    const uint32_t roof = 12 * CN_SKY_HINT_Y / HEIGHT;
    wall_init(&w, NOTHING, GREY_SKY);
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_true(cn_sky_hints_find(&input, &w.tile, hint));
    uint32_t shown = 0, none = 0;
    for (uint32_t i = 0; i < sizeof hint; i++) {
        const uint32_t y = i / CN_SKY_HINT_X % CN_SKY_HINT_Y;
        if (y < roof)
            assert_int_not_equal(hint[i], CN_SKY_NONE);
        else
            assert_int_not_equal(hint[i], CN_SKY_SHOWN);
        shown += y + 4 < roof && hint[i] == CN_SKY_SHOWN;
        none += y > roof + 16 && hint[i] == CN_SKY_NONE;
    }
    assert_int_equal(shown, VIEWS * (roof - 4) * CN_SKY_HINT_X);
    assert_true(none > sizeof hint / 2);
    /* A photo without points tells nothing. */
    w.scene.n_points = 0;
    assert_true(cn_sky_hints_find(&input, &w.tile, hint));
    for (uint32_t i = 0; i < sizeof hint; i++)
        assert_int_equal(hint[i], CN_SKY_UNKNOWN);
    wall_deinit(&w);
}

/* Hints of view 0 within the tower or cloud, above the roof and away from its edges. */
static void count_hints(const wall *w, before what, const uint8_t *hint, uint32_t n[3])
{
    const double origin[3] = { camera_x(0), 0, 2 };
    memset(n, 0, 3 * sizeof *n);
    for (uint32_t i = 0; i < CN_SKY_HINTS; i++) {
        const uint32_t x = i % CN_SKY_HINT_X, y = i / CN_SKY_HINT_X;
        double in_camera[3], dir[3];
        assert_int_equal(cn_camera_unproject(&w->camera, (x + 0.5) * WIDTH / CN_SKY_HINT_X,
                                             (y + 0.5) * HEIGHT / CN_SKY_HINT_Y, in_camera),
                         CN_OK);
        cn_mat3_tvec(w->views[0].rotation, in_camera, dir);
        const double across = origin[0] + BOX_M / dir[1] * dir[0], up = origin[2] + BOX_M / dir[1] * dir[2];
        if (!in_thing(what, 0, origin, dir) || fabs(across) > 0.8 || up < (what == CLOUD ? 6 : 5.3)) continue;
        assert_true(hint[i] <= CN_SKY_SHOWN);
        n[hint[i]]++;
    }
}

/* Something reaches to the top edge of view 0, without points of that view. seen_by_others: other views see points on
 * it. */
static void hints_on(before what, double grey, bool seen_by_others, uint32_t n[3])
{
    static wall w;
    static uint8_t hint[VIEWS * CN_SKY_HINTS];
    thing_grey = grey;
    wall_init(&w, what, GREY_SKY);
    for (int i = 0; seen_by_others && i < 50; i++) {
        cn_point *p = &w.points[w.scene.n_points];
        add_point(&w, what, (double[3]){ i % 10 * 0.2 - 0.9, BOX_M, 5.1 + 0.34 * (i / 10) }, true);
        while (w.observations[p->first_observation].view < VIEWS / 2) {
            p->first_observation++;
            p->n_observations--;
        }
    }
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_true(cn_sky_hints_find(&input, &w.tile, hint));
    count_hints(&w, what, hint, n);
    wall_deinit(&w);
    thing_grey = 0.02;
}

/* A smooth wall that reaches to the top of a photo looks like sky. It is none where other photos see points, and none
 * when its colour is not that of the rest. What is dark is no sky, but may be a cloud when sky is below it. A bright
 * cloud is sky. */
static void test_no_sky_at_top(void **state)
{
    (void)state;
    uint32_t n[3];
    hints_on(TOWER, 0.6, false, n); /* looks like the sky: nothing tells it apart */
    assert_true(n[CN_SKY_SHOWN] > 500 && n[CN_SKY_NONE] == 0);
    hints_on(TOWER, 0.6, true, n);
    assert_true(n[CN_SKY_NONE] > 500 && n[CN_SKY_SHOWN] < 250); /* shown: between points and the photo's edge */
    hints_on(TOWER, 0.42, false, n);
    assert_int_equal(n[CN_SKY_SHOWN], 0);
    assert_int_equal(n[CN_SKY_NONE], 0);
    hints_on(TOWER, 0.1, false, n);
    assert_true(n[CN_SKY_NONE] > 500 && n[CN_SKY_SHOWN] == 0);
    hints_on(CLOUD, 0.1, false, n);
    assert_true(n[CN_SKY_UNKNOWN] > 100 && n[CN_SKY_NONE] == 0 && n[CN_SKY_SHOWN] == 0);
    hints_on(CLOUD, 0.9, false, n);
    assert_true(n[CN_SKY_SHOWN] > 100 && n[CN_SKY_NONE] == 0 && n[CN_SKY_UNKNOWN] == 0);
}

/* Points that are off the roof's edge, in the sky, do not hide the sky between them and the roof. */
static void test_sky_along_roof(void **state)
{
    (void)state;
    static wall w;
    static uint8_t hint[VIEWS * CN_SKY_HINTS];
    const uint32_t roof = 12 * CN_SKY_HINT_Y / HEIGHT;
    wall_init(&w, NOTHING, GREY_SKY);
    for (int i = 0; i < 50; i++)
        add_point(&w, NOTHING, (double[3]){ i * 0.5 - 12.5, WALL_M, ROOF_M + 0.5 }, false);
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_true(cn_sky_hints_find(&input, &w.tile, hint));
    for (uint32_t i = 0; i < sizeof hint; i++) {
        const uint32_t y = i / CN_SKY_HINT_X % CN_SKY_HINT_Y;
        if (y + 2 < roof) assert_int_equal(hint[i], CN_SKY_SHOWN);
        if (y >= roof) assert_int_not_equal(hint[i], CN_SKY_SHOWN);
    }
    wall_deinit(&w);
}

/* A wall as bright as the sky, beside it, goes on for more than a strip. It is no sky. */
static void test_no_sky_across_a_wall(void **state)
{
    (void)state;
    static wall w;
    static uint8_t hint[VIEWS * CN_SKY_HINTS];
    white_wall = true;
    wall_init(&w, NOTHING, GREY_SKY);
    white_wall = false;
    w.scene.n_points = 0;
    w.scene.n_observations = 0;
    for (int i = 0; i < 40; i++)
        add_point(&w, NOTHING, (double[3]){ WHITE_TO_M - 0.5 - i * 0.5, WALL_M, ROOF_M - 0.2 }, false);
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_true(cn_sky_hints_find(&input, &w.tile, hint));
    uint32_t beside = 0;
    for (uint32_t i = 24 * CN_SKY_HINT_X; i < 80 * CN_SKY_HINT_X; i++) { /* from above the roof's edge to the horizon */
        const double x = camera_x(0) + ((i % CN_SKY_HINT_X + 0.5) * WIDTH / CN_SKY_HINT_X - 48) / 80 * WALL_M;
        if (x < WHITE_TO_M - 1 && i / CN_SKY_HINT_X > 48)
            assert_int_not_equal(hint[i], CN_SKY_SHOWN);
        else if (x > WHITE_TO_M + 1)
            beside += hint[i] == CN_SKY_SHOWN;
    }
    assert_true(beside > 500);
    wall_deinit(&w);
}

/* The border of a photo is no sky, and below it the sky is found. */
static void test_sky_below_border(void **state)
{
    (void)state;
    static wall w;
    static uint8_t hint[VIEWS * CN_SKY_HINTS];
    border_px = 4;
    wall_init(&w, NOTHING, GREY_SKY);
    border_px = 0;
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_true(cn_sky_hints_find(&input, &w.tile, hint));
    const uint32_t first = 4 * CN_SKY_HINT_Y / HEIGHT + 2, roof = 12 * CN_SKY_HINT_Y / HEIGHT;
    for (uint32_t i = 0; i < sizeof hint; i++) {
        const uint32_t y = i / CN_SKY_HINT_X % CN_SKY_HINT_Y;
        if (y >= first && y < roof - 4) assert_int_equal(hint[i], CN_SKY_SHOWN);
    }
    wall_deinit(&w);
}

/* In a photo on its head, sky is below the points. Nothing is said of it. */
static void test_photo_on_its_head(void **state)
{
    (void)state;
    static wall w;
    static uint8_t hint[VIEWS * CN_SKY_HINTS];
    first_on_its_head = true;
    wall_init(&w, NOTHING, GREY_SKY);
    first_on_its_head = false;
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_true(cn_sky_hints_find(&input, &w.tile, hint));
    for (uint32_t i = 0; i < CN_SKY_HINTS; i++)
        assert_int_equal(hint[i], CN_SKY_UNKNOWN);
    assert_int_equal(hint[CN_SKY_HINTS + 5 * CN_SKY_HINT_X + 5], CN_SKY_SHOWN);
    wall_deinit(&w);
}

/* A parked thing hides other parts of the wall in each photo, although nothing moves. */
static void test_transient(void **state)
{
    (void)state;
    const double parked = evidence(cn_tracks_transient, PARKED, NO_SKY),
                 passing = evidence(cn_tracks_transient, PASSING, NO_SKY);
    assert_true(fabs(parked) < 0.01 || isnan(parked));
    assert_true(passing > 0.3);
    /* Photos 6 degrees apart cannot tell a statue from a passer-by. */
    step_m = 2;
    const double statue = evidence(cn_tracks_transient, STATUE, NO_SKY);
    step_m = 0.25;
    assert_true(fabs(statue) < 0.01 || isnan(statue));
}

/* On for few photos, off for many, unknown without sparse points. */
static void test_stereo_depth(void **state)
{
    (void)state;
    static wall w;
    wall_init(&w, NOTHING, NO_SKY);
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    const cn_effect *effect = cn_effect_find("stereo_depth");
    assert_non_null(effect);
    const double all = effect->evidence(&input, &w.tile);
    assert_true(fabs(all - 10.0 / VIEWS) < 1e-12);
    w.tile.n_photos = 9;
    const double few = effect->evidence(&input, &w.tile);
    assert_true(few > effect->threshold);
    w.tile.n_photos = 2;
    assert_true(isnan(effect->evidence(&input, &w.tile)));
    w.tile.n_photos = VIEWS;
    w.scene.n_observations = 0;
    assert_true(isnan(effect->evidence(&input, &w.tile)));
    wall_deinit(&w);
}

/* Found where there is some, and taken out of a pixel. Unknown without sparse points. */
static void test_vignetting(void **state)
{
    (void)state;
    static wall w;
    const cn_effect *effect = cn_effect_find("vignetting");
    const cn_pixel_extent size = { WIDTH, HEIGHT };
    cn_vignetting found[VIEWS];
    assert_non_null(effect);
    assert_true(evidence(effect->evidence, NOTHING, NO_SKY) < 0.02);
    for (int moving = 0; moving < 2; moving++) {
        wall_init_through(&w, moving ? PASSING : NOTHING, NO_SKY, 0.8, false);
        const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
        const double sure = effect->evidence(&input, &w.tile);
        assert_true(sure > effect->threshold && sure < 0.85);
        assert_int_equal(cn_vignetting_find(&input, &w.tile, VIEWS, w.photos, found), CN_OK);
        for (unsigned v = 0; v < VIEWS; v++) {
            const float corner = cn_vignetting_factor(&found[v], size, 0, 0);
            assert_true(fabsf(log2f(corner) + 0.8f) < 0.08f);
            assert_true(cn_vignetting_factor(&found[v], size, WIDTH / 2.0, HEIGHT / 2.0) == 1);
        }
        if (!moving) wall_deinit(&w);
    }
    float rgb[3] = { 0.25f, 0.5f, 0.125f };
    cn_vignetting_remove(&(cn_vignetting){ -1, -1 }, (cn_pixel_extent){ 1, 1 }, 0, 0, rgb);
    assert_true(rgb[0] == 0.25f && rgb[1] == 0.5f && rgb[2] == 0.125f); /* the middle */
    cn_vignetting_remove(&found[0], size, 0, 0, rgb);
    const float corner = cn_vignetting_factor(&found[0], size, 0.5, 0.5);
    assert_true(fabsf(rgb[1] * corner - 0.5f) < 5e-4f && fabsf(rgb[0] * corner - 0.25f) < 3e-4f);
    w.scene.n_points = 0;
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_true(isnan(effect->evidence(&input, &w.tile)));
    assert_int_equal(cn_vignetting_find(&input, &w.tile, VIEWS, w.photos, found), CN_ERR_DATA);
    wall_deinit(&w);
}

/* Two cameras in one tile, of which one has a lens without vignetting. A third that has no photo gets what both have.
 */
static void test_vignetting_of_two_cameras(void **state)
{
    (void)state;
    static wall w;
    cn_vignetting found[VIEWS];
    wall_init_through(&w, NOTHING, NO_SKY, 0.8, true);
    cn_camera cameras[] = { w.camera, w.camera, w.camera };
    w.scene.cameras = cameras;
    w.scene.n_cameras = 3;
    for (unsigned v = 0; v < VIEWS; v++)
        w.views[v].camera = v % 2;
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_int_equal(cn_vignetting_find(&input, &w.tile, VIEWS, w.photos, found), CN_OK);
    for (unsigned v = 0; v < VIEWS; v++) {
        const float corner = log2f(cn_vignetting_factor(&found[v], (cn_pixel_extent){ WIDTH, HEIGHT }, 0, 0));
        assert_true(fabsf(corner + (v % 2 ? 0 : 0.8f)) < 0.12f);
    }
    w.tile.n_photos = VIEWS - 1;
    w.views[VIEWS - 1].camera = 2;
    assert_int_equal(cn_vignetting_find(&input, &w.tile, 1, &w.photos[VIEWS - 1], found), CN_OK);
    const float corner = found[0].square + found[0].fourth;
    assert_true(corner < -0.2f && corner > -0.6f);
    wall_deinit(&w);
}

/* A photo's stripes are two pixels of its store apart, and a patch is two pixels wide: it shows their mean. A masked
 * pixel masks its patch. */
static void test_colour_of_a_patch(void **state)
{
    (void)state;
    enum { WIDE = 2 * CN_TRACKS_FINE, HIGH = 16 };
    static float rgba[4 * WIDE * HIGH];
    for (unsigned i = 0; i < WIDE * HIGH; i++)
        for (unsigned c = 0; c < 4; c++)
            rgba[4 * i + c] = c == 3 ? (i % WIDE != 600) : i % 2 ? 0.2F : 0.6F;
    char folder[] = "/tmp/conurb-patch-XXXXXX";
    assert_non_null(mkdtemp(folder));
    char *path = cn_path_join(folder, "0.png"), *file = cn_path_join(folder, "pixels.bin");
    assert_int_equal(cn_oiio_write_png(path, rgba, WIDE, HIGH, 4, NULL), CN_OK);
    const cn_context quiet = { 0 };
    cn_photo_index index;
    cn_pixel_store *pixels;
    assert_int_equal(cn_photo_index_scan(&quiet, folder, &index), CN_OK);
    assert_int_equal(cn_pixel_store_build(&quiet, &index, WIDE, file), CN_OK);
    assert_int_equal(cn_pixel_store_open(&pixels, file), CN_OK);
    cn_camera camera = { .width = WIDE, .height = HIGH };
    cn_scene scene = { .cameras = &camera, .n_cameras = 1 };
    const cn_plan_input input = { .scene = &scene, .photos = &index, .pixels = pixels };
    const cn_view view = { .photo = 0 };
    const cn_track_patch fine = { CN_TRACKS_FINE, 0.001F }, pixel = { WIDE, 0.001F };
    cn_track_observation mean, dark, bright;
    for (int x = 100; x < 110; x++) {
        assert_true(cn_tracks_colour(&input, &view, x + 0.4, 8, fine, &mean));
        assert_float_equal(exp2f(mean.log2_luminance), 0.5 * (cn_srgb_decode(0.2) + cn_srgb_decode(0.6)), 0.002);
    }
    assert_true(cn_tracks_colour(&input, &view, 100.4, 8, pixel, &bright));
    assert_true(cn_tracks_colour(&input, &view, 101.4, 8, pixel, &dark));
    assert_true(bright.log2_luminance > dark.log2_luminance + 2);
    assert_false(cn_tracks_colour(&input, &view, 601.2, 8, fine, &mean));
    cn_pixel_store_close(&pixels);
    cn_photo_index_deinit(&index);
    char *command = cn_format("rm -rf %s", folder);
    assert_int_equal(system(command), 0);
    free(command);
    free(file);
    free(path);
}

/* What differs between the photos of a wall, in stops. */
typedef enum differs { NOISE, LENS, SHADE } differs;

/* Nine photos of a wall, 20 m away, with tracked points 0.4 m apart. */
static double local_light(differs by)
{
    enum { SIDE = 24, PHOTOS = 9, ALL = SIDE * SIDE * PHOTOS };
    static cn_track_observation observations[ALL];
    for (uint32_t i = 0; i < ALL; i++) {
        const uint32_t point = i / PHOTOS, photo = i % PHOTOS;
        const double x = 0.4 * (point % SIDE) - 0.2 * SIDE, z = 0.4 * (point / SIDE) - 0.2 * SIDE,
                     distance = sqrt(x * x + z * z + 400), square = (x * x + z * z) / 50;
        const bool in_shade = x + z > photo - 4.0;
        const double residual = by == NOISE  ? (double)cn_rng_float(3, photo, point) - 0.5
                                : by == LENS ? 0.5 * (0.46 - square)
                                             : (in_shade ? -0.3 : 0.3);
        observations[i] =
            (cn_track_observation){ .point = point,
                                    .photo = photo,
                                    .square = (float)square,
                                    .dir = { (float)(-x / distance), (float)(-20 / distance), (float)(-z / distance) },
                                    .distance_m = (float)distance,
                                    .residual = (float)residual };
    }
    return cn_tracks_local_light(&(cn_tracks){ .observations = observations, .n = ALL, .n_photos = PHOTOS });
}

/* A shadow that moves over the wall is light. Noise and the lens are not. */
static void test_local_light(void **state)
{
    (void)state;
    assert_true(local_light(NOISE) < 0.03);
    assert_true(local_light(LENS) < 0.01);
    const double shade = local_light(SHADE);
    assert_true(shade > 0.2 && shade < 0.31);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_sky),
                                        cmocka_unit_test(test_sky_hints),
                                        cmocka_unit_test(test_no_sky_at_top),
                                        cmocka_unit_test(test_sky_along_roof),
                                        cmocka_unit_test(test_no_sky_across_a_wall),
                                        cmocka_unit_test(test_sky_below_border),
                                        cmocka_unit_test(test_photo_on_its_head),
                                        cmocka_unit_test(test_transient),
                                        cmocka_unit_test(test_stereo_depth),
                                        cmocka_unit_test(test_vignetting),
                                        cmocka_unit_test(test_vignetting_of_two_cameras),
                                        cmocka_unit_test(test_local_light),
                                        cmocka_unit_test(test_colour_of_a_patch) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
