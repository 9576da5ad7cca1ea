/* Evidence of effects other than the sky's, on photos that the test draws. */
#include "../common.h"
#include "wall.h"

#include "base/file.h"
#include "base/rng.h"
#include "base/srgb.h"
#include "bridge/oiio.h"
#include "effect/effect.h"
#include "effect/tracks.h"
#include "effect/vignetting.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

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

/* Of a point that very many photos track not every observation is kept. Photos whose observation is not kept do not
 * count as photos without the point: each photo taken four times gives the evidence of taking it once. */
static void test_transient_of_long_tracks(void **state)
{
    (void)state;
    enum { COPIES = 4, ALL = COPIES * VIEWS };
    static wall w;
    static cn_view views[ALL];
    static cn_observation observations[COPIES * POINTS * VIEWS];
    static cn_point points[POINTS];
    uint32_t photos[ALL], n = 0;
    wall_init(&w, PASSING, NO_SKY);
    const cn_plan_input once = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    const double expected = cn_tracks_transient(&once, &w.tile);
    for (uint32_t v = 0; v < ALL; v++) {
        views[v] = w.views[v % VIEWS];
        photos[v] = v;
    }
    for (uint32_t p = 0; p < w.scene.n_points; p++) {
        points[p] = w.points[p];
        points[p].first_observation = n;
        points[p].n_observations *= COPIES;
        for (uint32_t i = 0; i < points[p].n_observations; i++) {
            const uint32_t one = w.points[p].n_observations;
            observations[n] = w.observations[w.points[p].first_observation + i % one];
            observations[n++].view += i / one * VIEWS;
        }
    }
    cn_scene scene = w.scene;
    scene.views = views;
    scene.n_views = ALL;
    scene.points = points;
    scene.observations = observations;
    scene.n_observations = n;
    const cn_plan_input input = { .scene = &scene, .photos = &w.index, .pixels = w.pixels };
    const cn_plan_tile tile = { .id = "four times", .photos = photos, .n_photos = ALL };
    assert_float_equal(cn_tracks_transient(&input, &tile), expected, 0.05);
    wall_deinit(&w);
}

/* Photos by many cameras have more evidence, if they are many. Those of a camera that is turned are by one. */
static void test_strangers_and_few_photos(void **state)
{
    (void)state;
    static wall w;
    wall_init(&w, PASSING, NO_SKY);
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    const cn_effect *effect = cn_effect_find("transient");
    assert_non_null(effect);
    const double seen = cn_tracks_transient(&input, &w.tile);
    for (unsigned i = 1; i < VIEWS; i += 2) {
        w.index.photos[i].width = HEIGHT;
        w.index.photos[i].height = WIDTH;
    }
    assert_true(fabs(effect->evidence(&input, &w.tile) - seen) < 1e-12);
    for (unsigned i = 0; i < VIEWS / 4; i++)
        w.index.photos[i].width = 200 + i;
    assert_true(fabs(effect->evidence(&input, &w.tile) - seen - 0.03) < 1e-12);
    w.tile.n_photos = 19;
    assert_true(fabs(effect->evidence(&input, &w.tile) - cn_tracks_transient(&input, &w.tile)) < 1e-12);
    /* Of few photos, the layer would take the scene itself. */
    w.tile.n_photos = 14;
    const double few = effect->evidence(&input, &w.tile), of_few = cn_tracks_transient(&input, &w.tile);
    assert_true(of_few > 0.1 && fabs(few - 0.05 * of_few) < 1e-12);
    wall_deinit(&w);
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

static void set_exposure(wall *w, double even_s, double odd_s)
{
    for (unsigned i = 0; i < VIEWS; i++) {
        cn_photo *photo = &w->index.photos[i];
        photo->exposure_s = i % 2 ? odd_s : even_s;
        photo->iso = 100;
        photo->f_number = 8;
    }
}

/* What EXIF says, or what the photos show, whichever is more. Without sparse points EXIF alone tells. A photo without
 * the f-number that the others have is not six stops brighter. */
static void test_exposure(void **state)
{
    (void)state;
    static wall w;
    const cn_effect *effect = cn_effect_find("exposure");
    assert_non_null(effect);
    for (int gains = 0; gains < 2; gains++) {
        gain_stops = gains * 0.6;
        wall_init(&w, NOTHING, NO_SKY);
        gain_stops = 0;
        const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
        const double shown = effect->evidence(&input, &w.tile);
        assert_float_equal(shown, gains * 0.3, 0.02);
        set_exposure(&w, 0.01, 0.01);
        assert_float_equal(effect->evidence(&input, &w.tile), shown, 1e-9);
        w.index.photos[0].f_number = NAN;
        assert_float_equal(effect->evidence(&input, &w.tile), shown, 1e-9);
        set_exposure(&w, 0.01, 0.02);
        assert_float_equal(effect->evidence(&input, &w.tile), 0.5, 1e-6);
        w.scene.n_points = 0;
        assert_float_equal(effect->evidence(&input, &w.tile), 0.5, 1e-6);
        set_exposure(&w, NAN, NAN);
        assert_true(isnan(effect->evidence(&input, &w.tile)));
        wall_deinit(&w);
    }
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

/* A tile's vignetting does not depend on how many tiles the city has: their points lie between its own. */
static void test_vignetting_in_a_city(void **state)
{
    (void)state;
    static wall w;
    enum { TILES = 300 };
    cn_vignetting alone, in_city;
    wall_init_through(&w, NOTHING, NO_SKY, 0.8, false);
    const cn_plan_input input = { .scene = &w.scene, .photos = &w.index, .pixels = w.pixels };
    assert_int_equal(cn_vignetting_find(&input, &w.tile, 1, w.photos, &alone), CN_OK);
    cn_scene city = w.scene;
    city.n_points = TILES * w.scene.n_points;
    city.points = calloc(city.n_points, sizeof *city.points);
    assert_non_null(city.points);
    for (uint32_t i = 0; i < w.scene.n_points; i++)
        city.points[i * TILES + i % TILES] = w.points[i];
    const cn_plan_input of_city = { .scene = &city, .photos = &w.index, .pixels = w.pixels };
    assert_int_equal(cn_vignetting_find(&of_city, &w.tile, 1, w.photos, &in_city), CN_OK);
    assert_memory_equal(&in_city, &alone, sizeof alone);
    free(city.points);
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
    assert_int_equal(folder_remove(folder), 0);
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
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_transient),
                                        cmocka_unit_test(test_transient_of_long_tracks),
                                        cmocka_unit_test(test_strangers_and_few_photos),
                                        cmocka_unit_test(test_stereo_depth),
                                        cmocka_unit_test(test_exposure),
                                        cmocka_unit_test(test_vignetting),
                                        cmocka_unit_test(test_vignetting_in_a_city),
                                        cmocka_unit_test(test_vignetting_of_two_cameras),
                                        cmocka_unit_test(test_local_light),
                                        cmocka_unit_test(test_colour_of_a_patch) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
