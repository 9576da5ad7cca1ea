/* Fits of an appearance to rays, by a tile that is trained once with appearance and sky, and by one with exposure too.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "conurb/measure.h"
#include "conurb/render.h"
#include "effect/display.h"
#include "synthetic.h"
#include "math/linalg.h"
#include "tile/model.h"
#include "train/fit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static synthetic_scene synthetic;
static cn_tile *tile, *with_gains;

/* Trains a tile with the first n effects of a list. */
static cn_tile *trained(uint32_t n, const char *name)
{
    static const char *const names[] = { "appearance", "sky", "exposure" };
    synthetic.tile.n_effects = n;
    for (uint32_t i = 0; i < n; i++) {
        synthetic.tile.effects[i] = (cn_plan_effect){ .on = true };
        strcpy(synthetic.tile.effects[i].name, names[i]);
    }
    cn_train_options o = synthetic_options();
    o.steps = 300;
    cn_pool *pool = NULL;
    cn_tile *made = NULL;
    assert_int_equal(cn_pool_create(&pool, 2), CN_OK);
    const cn_context ctx = { .pool = pool };
    const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
    cn_train_result result;
    char dir[128], path[160];
    snprintf(dir, sizeof dir, "%s/%s", synthetic.folder, name);
    snprintf(path, sizeof path, "%s/tile.safetensors", dir);
    assert_int_equal(cn_train_tile(&ctx, &input, &o, "parent", dir, &result), CN_OK);
    cn_pool_destroy(&pool);
    assert_int_equal(cn_tile_open(&made, path), CN_OK);
    return made;
}

static int make(void **state)
{
    (void)state;
    synthetic_scene_init(&synthetic, 17);
    tile = trained(2, "codes");
    with_gains = trained(3, "gains");
    return 0;
}

static int unmake(void **state)
{
    (void)state;
    cn_tile_close(&tile);
    cn_tile_close(&with_gains);
    synthetic_scene_deinit(&synthetic);
    return 0;
}

/* Rays of a held-out view, with their colours times a gain, in the layout of a fit. */
static size_t fit_rays(const cn_view *v, float gain, double (*origin)[3], double (*direction)[3], float (*target)[4])
{
    float truth[48 * 36 * 4];
    double centre[3], in_camera[3];
    assert_int_equal(cn_pixel_store_read(synthetic.pixels, v->photo, truth), CN_OK);
    cn_view_centre(v, centre);
    for (uint32_t i = 0; i < 48 * 36; i++) {
        assert_int_equal(cn_camera_unproject(&synthetic.scene.cameras[0], i % 48 + 0.5, i / 48 + 0.5, in_camera),
                         CN_OK);
        cn_mat3_tvec(v->rotation, in_camera, direction[i]);
        memcpy(origin[i], centre, sizeof centre);
        for (size_t c = 0; c < 4; c++)
            target[i][c] = truth[4 * i + c] * (c < 3 ? gain : 1);
    }
    return 48 * 36;
}

/* What rays show in a row's light. */
static void show(const cn_tile *by, const cn_appearance *row, size_t n, double (*origin)[3], double (*direction)[3],
                 float (*rgba)[4])
{
    const cn_context ctx = { 0 };
    static float depth[48 * 36];
    cn_render_options r = cn_render_options_default();
    r.appearance = row;
    assert_int_equal(cn_render_rays(&ctx, by,
                                    &(cn_ray_list){ n, (const double(*)[3])origin, (const double(*)[3])direction }, &r,
                                    rgba[0], depth),
                     CN_OK);
}

/* Root mean square error of a row against the rays' colours, display-encoded as a fit has it. */
static double error_of(const cn_tile *by, const cn_appearance *row, size_t n, double (*origin)[3],
                       double (*direction)[3], float (*target)[4])
{
    static float rgba[48 * 36][4];
    double sum = 0;
    show(by, row, n, origin, direction, rgba);
    for (size_t i = 0; i < n; i++) {
        float seen[3], wanted[3];
        cn_display(rgba[i], seen);
        cn_display(target[i], wanted);
        for (int c = 0; c < 3; c++)
            sum += (double)(seen[c] - wanted[c]) * (double)(seen[c] - wanted[c]);
    }
    return sqrt(sum / (3 * (double)n));
}

/* A light that no photo had: a fit comes nearer to it than the mean row, changes no geometry, and does not read
 * held-out pixels. */
static void test_fit_finds_the_light(void **state)
{
    (void)state;
    assert_true(cn_tile_has_appearance(tile));
    static double origin[48 * 36][3], direction[48 * 36][3];
    static float target[48 * 36][4];
    const size_t n = fit_rays(&synthetic.scene.views[synthetic.tile.held_out[0]], 3.0f, origin, direction, target);
    const cn_context ctx = { 0 };
    cn_appearance mean, row, mixed;
    double found, none;
    assert_int_equal(cn_tile_appearance(tile, NULL, &mean), CN_OK);
    row = mean;
    assert_int_equal(
        cn_fit_appearance(
            &ctx, tile,
            &(cn_lit_rays){ { n, (const double(*)[3])origin, (const double(*)[3])direction }, target[0], true }, &row,
            &found),
        CN_OK);
    const double with_mean = error_of(tile, &mean, n, origin, direction, target);
    const double with_fit = error_of(tile, &row, n, origin, direction, target);
    print_message("fit: rms error %.4f, rendered %.4f, of the mean light %.4f\n", found, with_fit, with_mean);
    assert_true(with_fit < 0.9 * with_mean);
    /* The same number of rays of weight 0 leave nothing to fit to. */
    for (size_t i = 0; i < n; i++)
        target[i][3] = 0;
    mixed = mean;
    assert_int_equal(
        cn_fit_appearance(
            &ctx, tile,
            &(cn_lit_rays){ { n, (const double(*)[3])origin, (const double(*)[3])direction }, target[0], true }, &mixed,
            &none),
        CN_ERR_DATA);
    float rgba[2][4], depth[2];
    cn_render_options r = cn_render_options_default();
    assert_int_equal(cn_render_rays(&ctx, tile,
                                    &(cn_ray_list){ 1, (const double(*)[3])origin, (const double(*)[3])direction }, &r,
                                    rgba[0], &depth[0]),
                     CN_OK);
    r.appearance = &row;
    assert_int_equal(cn_render_rays(&ctx, tile,
                                    &(cn_ray_list){ 1, (const double(*)[3])origin, (const double(*)[3])direction }, &r,
                                    rgba[1], &depth[1]),
                     CN_OK);
    assert_true(depth[0] == depth[1]);
    assert_true(memcmp(rgba[0], rgba[1], sizeof rgba[0]) != 0);
    assert_true(found < 0.16);
    cn_appearance_mix(&mean, &row, 0.5, &mixed);
    for (uint32_t i = 0; i < row.n; i++)
        assert_true(fabsf(mixed.row[i] - 0.5f * (mean.row[i] + row.row[i])) < 1e-5f);
    mixed.n++;
    r.appearance = &mixed;
    assert_int_equal(cn_render_rays(&ctx, tile,
                                    &(cn_ray_list){ 1, (const double(*)[3])origin, (const double(*)[3])direction }, &r,
                                    rgba[1], &depth[1]),
                     CN_ERR_USAGE);
}

/* Puts a picture's rays in order of columns, from left to right. */
static void by_columns(size_t n_columns, double (*origin)[3], double (*direction)[3], float (*target)[4])
{
    static double o[48 * 36][3], d[48 * 36][3];
    static float t[48 * 36][4];
    memcpy(o, origin, sizeof o);
    memcpy(d, direction, sizeof d);
    memcpy(t, target, sizeof t);
    for (size_t i = 0; i < n_columns * 36; i++) {
        const size_t from = i % 36 * n_columns + i / 36;
        memcpy(origin[i], o[from], sizeof o[from]);
        memcpy(direction[i], d[from], sizeof d[from]);
        memcpy(target[i], t[from], sizeof t[from]);
    }
}

/* A photo in the mean light, with a tree over a third of its left half. A fit to the left half must not darken the
 * right one. */
static void test_fit_is_not_misled(void **state)
{
    (void)state;
    static double origin[48 * 36][3], direction[48 * 36][3];
    static float target[48 * 36][4];
    const size_t n = fit_rays(&synthetic.scene.views[synthetic.tile.held_out[0]], 1, origin, direction, target);
    by_columns(48, origin, direction, target);
    const cn_context ctx = { 0 };
    cn_appearance mean, row;
    double found;
    assert_int_equal(cn_tile_appearance(tile, NULL, &mean), CN_OK);
    row = mean;
    show(tile, &mean, n, origin, direction, target);
    for (size_t i = 0; i < n; i++)
        for (int c = 0; c < 4; c++)
            target[i][c] = c == 3 ? 1 : i < n / 6 ? 0.001f : target[i][c];
    assert_int_equal(
        cn_fit_appearance(
            &ctx, tile,
            &(cn_lit_rays){ { n / 2, (const double(*)[3])origin, (const double(*)[3])direction }, target[0], true },
            &row, &found),
        CN_OK);
    const size_t h = n / 2;
    const double with_fit = error_of(tile, &row, h, origin + h, direction + h, target + h);
    print_message("beside the fit: rms error %.4f\n", with_fit);
    assert_true(with_fit < 0.02);
}

/* A photo whose sky is far from that of every trained photo: what its left half shows of it is seen in its right half
 * too. */
static void test_fit_finds_a_new_sky(void **state)
{
    (void)state;
    static double origin[48 * 36][3], direction[48 * 36][3];
    static float target[48 * 36][4];
    const size_t n = fit_rays(&synthetic.scene.views[synthetic.tile.held_out[0]], 1, origin, direction, target);
    by_columns(48, origin, direction, target);
    const cn_context ctx = { 0 };
    cn_appearance mean, blue, row;
    double found;
    assert_int_equal(cn_tile_appearance(tile, NULL, &mean), CN_OK);
    blue = mean;
    for (uint32_t e = 0; e < tile->one.n_on; e++) {
        if (strcmp(tile->one.on[e].effect->name, "sky") != 0) continue;
        blue.row[tile->one.n_constants + tile->one.on[e].photo] -= 5; /* red of the sky */
        blue.row[tile->one.n_constants + tile->one.on[e].photo + 1] -= 3;
    }
    show(tile, &blue, n, origin, direction, target);
    for (size_t i = 0; i < n; i++)
        target[i][3] = 1;
    row = mean;
    const size_t h = n / 2;
    assert_int_equal(
        cn_fit_appearance(
            &ctx, tile,
            &(cn_lit_rays){ { h, (const double(*)[3])origin, (const double(*)[3])direction }, target[0], true }, &row,
            &found),
        CN_OK);
    const double with_mean = error_of(tile, &mean, h, origin + h, direction + h, target + h);
    const double with_fit = error_of(tile, &row, h, origin + h, direction + h, target + h);
    print_message("a new sky: rms error beside the fit %.4f, of the mean light %.4f\n", with_fit, with_mean);
    assert_true(with_mean > 0.03);
    assert_true(with_fit < 0.36 * with_mean); /* 0.43 where the prior does not know how few rays see a sky */
}

/* The trained photos share an exposure. Rays of a photo that is darker or brighter by whole stops still tell its gain,
 * and its other half is seen with it. */
static void test_fit_finds_a_new_exposure(void **state)
{
    (void)state;
    static double origin[48 * 36][3], direction[48 * 36][3];
    static float target[48 * 36][4];
    const cn_context ctx = { 0 };
    const size_t n = fit_rays(&synthetic.scene.views[synthetic.tile.held_out[0]], 1, origin, direction, target),
                 h = n / 2;
    by_columns(48, origin, direction, target);
    cn_appearance mean, other, row;
    assert_int_equal(cn_tile_appearance(with_gains, NULL, &mean), CN_OK);
    for (int stops = -3; stops <= 2; stops++) {
        double found;
        other = mean;
        for (uint32_t e = 0; e < with_gains->one.n_on; e++)
            if (strcmp(with_gains->one.on[e].effect->name, "exposure") == 0)
                other.row[with_gains->one.n_constants + with_gains->one.on[e].photo] += (float)stops;
        show(with_gains, &other, n, origin, direction, target);
        for (size_t i = 0; i < n; i++)
            target[i][3] = 1;
        row = mean;
        assert_int_equal(
            cn_fit_appearance(
                &ctx, with_gains,
                &(cn_lit_rays){ { h, (const double(*)[3])origin, (const double(*)[3])direction }, target[0], true },
                &row, &found),
            CN_OK);
        const double with_fit = error_of(with_gains, &row, h, origin + h, direction + h, target + h);
        print_message("%d stops: rms error beside the fit %.4f, of the mean light %.4f\n", stops, with_fit,
                      error_of(with_gains, &mean, h, origin + h, direction + h, target + h));
        assert_true(with_fit < 0.04); /* at -3 and 2: 0.30 and 0.40 where the gain has to be like the trained ones */
    }
}

/* Of a change that a fit found, only so much counts as the photo's two halves agree on. */
static void test_halves_have_to_agree(void **state)
{
    (void)state;
    static const float start[3] = { 1, 2, 3 }, along[3] = { 2, 2, 3 }, twice[3] = { 3, 2, 3 }, across[3] = { 1, 4, 3 },
                       back[3] = { 0, 2, 3 }, between[3] = { 2, 3, 3 };
    static const double even[3] = { 1, 1, 1 }, uneven[3] = { 1, 0, 1 }, nothing[3] = { 0 };
    assert_float_equal(cn_fit_agreement(3, start, (const float *const[2]){ along, twice }, even), 1, 1e-9);
    assert_float_equal(cn_fit_agreement(3, start, (const float *const[2]){ along, across }, even), 0, 1e-9);
    assert_float_equal(cn_fit_agreement(3, start, (const float *const[2]){ along, back }, even), 0, 1e-9);
    const double cosine = sqrt(0.5);
    assert_float_equal(cn_fit_agreement(3, start, (const float *const[2]){ along, between }, even),
                       2 * cosine / (1 + cosine), 1e-9);
    assert_float_equal(cn_fit_agreement(3, start, (const float *const[2]){ along, between }, uneven), 1, 1e-9);
    /* Nothing is known where a half changes nothing, or where it is not known what a change counts. */
    assert_float_equal(cn_fit_agreement(3, start, (const float *const[2]){ along, start }, even), 1, 1e-9);
    assert_float_equal(cn_fit_agreement(3, start, (const float *const[2]){ along, back }, nothing), 1, 1e-9);
}

/* Where rays do not tell which sky a photo has, it is that of the trained photos in its light. */
static void test_background_of_such_a_light(void **state)
{
    (void)state;
    cn_appearance mean, photo, row;
    double error[CN_FIT_STARTS];
    const uint32_t n = cn_fit_starts(tile);
    assert_true(n > 2);
    assert_int_equal(cn_tile_appearance(tile, NULL, &mean), CN_OK);
    assert_int_equal(cn_tile_appearance(tile, cn_fit_start_name(tile, 1), &photo), CN_OK);
    for (uint32_t i = 0; i < n; i++)
        error[i] = i == 0 ? NAN : i == 1 ? 0.001 : i == 2 ? INFINITY : 0.002;
    row = mean;
    cn_fit_expect_background(tile, error, &row);
    for (uint32_t e = 0; e < tile->one.n_on; e++) {
        const cn_effect_step *on = &tile->one.on[e];
        const bool sky = strcmp(on->effect->name, "sky") == 0;
        for (uint32_t c = 0; c < on->effect->photo_params; c++) {
            const uint32_t at = tile->one.n_constants + on->photo + c;
            assert_true(fabsf(row.row[at] - (sky ? photo : mean).row[at]) < 0.01f);
        }
    }
    for (uint32_t i = 0; i < n; i++)
        error[i] = INFINITY;
    row = mean;
    cn_fit_expect_background(tile, error, &row);
    assert_memory_equal(row.row, mean.row, row.n * sizeof *row.row);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fit_finds_the_light),        cmocka_unit_test(test_fit_is_not_misled),
        cmocka_unit_test(test_fit_finds_a_new_sky),        cmocka_unit_test(test_fit_finds_a_new_exposure),
        cmocka_unit_test(test_background_of_such_a_light), cmocka_unit_test(test_halves_have_to_agree),
    };
    return cmocka_run_group_tests(tests, make, unmake);
}
