/* Extreme photos: black, white, with NaN, twenty stops apart, and photos that see nothing. */
#include "hard.h"

#include "base/file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Writes an EXR of floats, byte by byte. The library's own writer limits colours to the range of half. */
static void put(FILE *f, const void *data, size_t size)
{
    assert_int_equal(fwrite(data, 1, size, f), size);
}
static void put_int(FILE *f, int32_t x)
{
    put(f, &x, 4);
}
static void put_float(FILE *f, float x)
{
    put(f, &x, 4);
}
static void put_name(FILE *f, const char *name, const char *type, int32_t size)
{
    put(f, name, strlen(name) + 1);
    put(f, type, strlen(type) + 1);
    put_int(f, size);
}
static void write_raw_exr(const char *path, int32_t w, int32_t h, const float *rgb)
{
    FILE *f = fopen(path, "wb");
    assert_non_null(f);
    put_int(f, 20000630);
    put_int(f, 2);
    put_name(f, "channels", "chlist", 3 * 18 + 1);
    for (int c = 0; c < 3; c++) {
        put(f, c == 0 ? "B" : c == 1 ? "G" : "R", 2);
        put_int(f, 2); /* float */
        put_int(f, 0);
        put_int(f, 1);
        put_int(f, 1);
    }
    put(f, "", 1);
    put_name(f, "compression", "compression", 1);
    put(f, "", 1);
    for (int i = 0; i < 2; i++) {
        put_name(f, i ? "displayWindow" : "dataWindow", "box2i", 16);
        put_int(f, 0), put_int(f, 0), put_int(f, w - 1), put_int(f, h - 1);
    }
    put_name(f, "lineOrder", "lineOrder", 1);
    put(f, "", 1);
    put_name(f, "pixelAspectRatio", "float", 4);
    put_float(f, 1);
    put_name(f, "screenWindowCenter", "v2f", 8);
    put_float(f, 0), put_float(f, 0);
    put_name(f, "screenWindowWidth", "float", 4);
    put_float(f, 1);
    put(f, "", 1);
    const uint64_t line = 8 + 12 * (uint64_t)w, first = (uint64_t)ftell(f) + 8 * (uint64_t)h;
    for (int32_t y = 0; y < h; y++) {
        const uint64_t at = first + line * (uint64_t)y;
        put(f, &at, 8);
    }
    for (int32_t y = 0; y < h; y++) {
        put_int(f, y);
        put_int(f, 12 * w);
        for (int c = 2; c >= 0; c--)
            for (int32_t x = 0; x < w; x++)
                put_float(f, rgb[3 * (y * w + x) + c]);
    }
    assert_int_equal(fclose(f), 0);
}

static void rebuild(synthetic_scene *synthetic)
{
    const cn_context quiet = { 0 };
    char *store = cn_path_join(synthetic->folder, "raw.bin"), *folder = cn_path_join(synthetic->folder, "painted");
    cn_photo_index_deinit(&synthetic->index);
    cn_pixel_store_close(&synthetic->pixels);
    hard_must(cn_photo_index_scan(&quiet, folder, &synthetic->index));
    hard_must(cn_pixel_store_build(&quiet, &synthetic->index, 48, store));
    hard_must(cn_pixel_store_open(&synthetic->pixels, store));
    free(store);
    free(folder);
}

static void same(unsigned photo, uint32_t x, uint32_t y, float rgb[3], float level)
{
    for (int c = 0; c < 3; c++)
        rgb[c] = level;
    if (x == 0 && y == 0)
        rgb[0] = level * (1 - 0.01f * (float)photo); /* files differ, because equal photos are left out */
}
static void paint_black(unsigned photo, uint32_t x, uint32_t y, float rgb[3])
{
    same(photo, x, y, rgb, 0);
    if (x == 0 && y == 0) rgb[0] = 1e-4f * (float)photo;
}
static void paint_white(unsigned photo, uint32_t x, uint32_t y, float rgb[3])
{
    same(photo, x, y, rgb, 1);
}
static void paint_squares(unsigned photo, uint32_t x, uint32_t y, float rgb[3])
{
    const float light = ((x / 8 + y / 8) & 1) ? 0.6f : 0.05f;
    same(photo, x, y, rgb, light);
    rgb[2] *= 0.5f;
}
static void paint_half_black(unsigned photo, uint32_t x, uint32_t y, float rgb[3])
{
    if (photo == 1)
        paint_black(photo, x, y, rgb);
    else if (photo == 2)
        paint_white(photo, x, y, rgb);
    else
        paint_squares(photo, x, y, rgb);
}

/* Steps under traps: nothing is skipped, nothing is bad, and everything stays finite. Returns the last step's squared
 * error a channel. */
static double step_safely(const synthetic_scene *synthetic, int steps)
{
    hard_run run;
    cn_train_options o = hard_options();
    o.steps = (uint32_t)steps;
    hard_run_init(&run, synthetic, &o, NULL);
    for (int i = 0; i < steps; i++) {
        hard_traps_on();
        hard_must(cn_trainer_step(&run.t));
        hard_traps_off();
        assert_true(run.t.monitor.skipped == 0 && run.t.stats.bad == 0);
    }
    assert_true(hard_finite(&run));
    const double loss = run.t.stats.squared_error / (3 * fmax((double)run.t.stats.rays, 1));
    hard_run_deinit(&run);
    return loss;
}

/* Black photos, and one black and one white among others.
 * Guard: the straight part of the sRGB curve in train/shade.c, which takes 0 and what is negative: without it the slope
 * at black is 0 / 0, and a colour outside sRGB is a root of a negative number. */
static void test_black(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    hard_scene_init(&synthetic, 4);
    hard_repaint(&synthetic, paint_half_black);
    step_safely(&synthetic, 16);
    const cn_train_options o = hard_options();
    hard_trained t = hard_train(&synthetic, &o);
    assert_true(t.bad_rays == 0);
    hard_repaint(&synthetic, paint_black);
    const double loss = step_safely(&synthetic, 150);
    print_message("all black: squared error %.2g\n", loss);
    assert_true(loss < 0.01); /* from 1: black is learned as black */
    t = hard_train(&synthetic, &o);
    assert_true(t.bad_rays == 0 && t.returns == 0);
    synthetic_scene_deinit(&synthetic);
}

/* White photos say "at least so bright": a field four times as bright is no worse, and is left alone.
 * Guard: CLIPPED in train/shade.c; without it every ray pulls. */
static void test_white(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    hard_run run;
    hard_scene_init(&synthetic, 3);
    hard_repaint(&synthetic, paint_white);
    const cn_train_options o = hard_options();
    hard_run_init(&run, &synthetic, &o, NULL);
    hard_fill(&run, 10);
    hard_colour(&run, 10, 3);
    hard_traps_on();
    hard_must(cn_trainer_step(&run.t));
    hard_traps_off();
    assert_true(run.t.stats.rays > 0 && run.t.stats.squared_error == 0);
    hard_run_deinit(&run);
    step_safely(&synthetic, 16);
    assert_true(hard_train(&synthetic, &o).bad_rays == 0);
    synthetic_scene_deinit(&synthetic);
}

/* NaN and infinities in an EXR have no weight, and the rest of the photo counts; a finite 1e38 becomes the largest
 * half; a photo of nothing but NaN counts for nothing. Guards: weigh() in photo/store_build.c, before colours are
 * cleaned of what is not finite (without it NaN is black, and is believed), and the largest half in image/image.c
 * (without it 1e38 is any number in the store). */
static void test_not_a_number(void **state)
{
    (void)state;
    enum { W = 48, H = 36 };
    synthetic_scene synthetic;
    hard_scene_init(&synthetic, 3);
    hard_repaint(&synthetic, paint_squares);
    static float rgb[3 * W * H], rgbw[4 * W * H];
    static const float odd[6] = { NAN, INFINITY, -INFINITY, 1e38f, -1e38f, 1e-42f };
    for (uint32_t i = 0; i < W * H; i++) {
        paint_squares(1, i % W, i / W, rgb + 3 * i);
        if (i % 7 == 0) rgb[3 * i + i / 7 % 3] = odd[i / 7 % 6];
    }
    char path[96];
    snprintf(path, sizeof path, "%s/painted/001.exr", synthetic.folder);
    write_raw_exr(path, W, H, rgb);
    for (uint32_t i = 0; i < 3 * W * H; i++)
        rgb[i] = NAN;
    snprintf(path, sizeof path, "%s/painted/002.exr", synthetic.folder);
    write_raw_exr(path, W, H, rgb);
    rebuild(&synthetic);
    hard_must(cn_pixel_store_read(synthetic.pixels, 1, rgbw));
    for (uint32_t i = 0; i < W * H; i++) {
        const bool lost = i % 7 == 0 && i / 7 % 6 < 3;
        for (int c = 0; c < 4; c++)
            assert_true(isfinite(rgbw[4 * i + c]));
        if (i % 7 == 0 && fabsf(odd[i / 7 % 6]) == 1e38f)
            assert_true(fabsf(rgbw[4 * i]) == 65504 && fabsf(rgbw[4 * i + 2]) == 65504);
        assert_true(rgbw[4 * i + 3] == (lost ? 0 : 1));
    }
    hard_must(cn_pixel_store_read(synthetic.pixels, 2, rgbw));
    for (uint32_t i = 0; i < W * H; i++)
        assert_true(rgbw[4 * i + 3] == 0);
    step_safely(&synthetic, 8);
    const cn_train_options o = hard_options();
    assert_true(hard_train(&synthetic, &o).bad_rays == 0);
    synthetic_scene_deinit(&synthetic);
}

static float gain_of(unsigned photo)
{
    return exp2f(10 * ((float)photo - 1));
} /* 20 stops from the first to the last of three */
static void paint_stops(unsigned photo, uint32_t x, uint32_t y, float rgb[3])
{
    paint_squares(0, x, y, rgb);
    for (int c = 0; c < 3; c++)
        rgb[c] = fminf(rgb[c] * gain_of(photo), 1);
    if (x == 0 && y == 0) rgb[0] = 0.5f - 0.1f * (float)photo;
}

/* Exposures twenty stops apart, by EXIF: one photo nearly black, one all white, and the one between them decides.
 * Without EXIF their gains are learned, and stay finite. Guard: one-sided clipping (CLIPPED, train/shade.c): without it
 * what the white photo pulls down costs 26 dB. */
static void test_twenty_stops(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    hard_scene_init(&synthetic, 3);
    hard_repaint(&synthetic, paint_stops);
    for (int known = 1; known >= 0; known--) {
        for (unsigned i = 0; i < 3; i++)
            synthetic.index.photos[i].exposure_s = known ? 0.01 * (double)gain_of(i) : NAN;
        hard_effects(&synthetic, "exposure", NULL);
        step_safely(&synthetic, 24);
        cn_train_options o = hard_options();
        o.steps = 120;
        const hard_trained t = hard_train(&synthetic, &o);
        print_message("20 stops, %s: %.2f dB\n", known ? "known" : "learned", t.psnr);
        assert_true(t.bad_rays == 0 && t.returns == 0 && t.psnr > (known ? 13 : 8));
    }
    synthetic_scene_deinit(&synthetic);
}

/* A photo that looks away from all others, and a set of photos none of which sees anything: a step without a single ray
 * is no step, and divides by nothing. Guard: `kept_rays ? kept_rays : 1` in train/composite.c and the first line of
 * cn_monitor_accepts; without the one a step is 1 / 0, without the other such steps count as trouble and training goes
 * back until it gives up. */
static void test_sees_nothing(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    hard_scene_init(&synthetic, 3);
    cn_view *v = &synthetic.scene.views[1];
    for (int k = 0; k < 9; k++)
        v->rotation[k] *= k < 3 ? 1 : -1; /* about its own x axis, so that it looks backwards */
    for (int k = 1; k < 3; k++)
        v->translation[k] *= -1;
    step_safely(&synthetic, 8);
    const cn_train_options o = hard_options();
    hard_train(&synthetic, &o);
    enum { W = 48, H = 36 };
    static float rgb[3 * W * H];
    hard_repaint(&synthetic, paint_squares);
    for (uint32_t i = 0; i < 3; i++) {
        char path[96];
        for (uint32_t p = 0; p < 3 * W * H; p++)
            rgb[p] = p > i ? NAN : INFINITY;
        snprintf(path, sizeof path, "%s/painted/%03u.exr", synthetic.folder, i);
        write_raw_exr(path, W, H, rgb);
    }
    rebuild(&synthetic);
    step_safely(&synthetic, 40);
    hard_effects(&synthetic, "sky", NULL); /* with a background, rays without samples are shaded too */
    step_safely(&synthetic, 8);
    const hard_trained t = hard_train(&synthetic, &o);
    assert_true(t.bad_rays == 0 && t.returns == 0);
    synthetic_scene_deinit(&synthetic);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_black),        cmocka_unit_test(test_white),        cmocka_unit_test(test_not_a_number),
        cmocka_unit_test(test_twenty_stops), cmocka_unit_test(test_sees_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
