#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "scratch.h"

#include "base/file.h"
#include "base/rng.h"
#include "conurb/colour.h"
#include "photo/border.h"
#include "photo/store.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static cn_pixel_store *build(scratch *s, uint32_t width_px)
{
    cn_photo_index index;
    cn_pixel_store *store;
    const char *path = scratch_path(s, "work/pixels");
    assert_int_equal(cn_photo_index_scan(&s->context, s->folder, &index), CN_OK);
    assert_int_equal(cn_pixel_store_build(&s->context, &index, width_px, path), CN_OK);
    cn_photo_index_deinit(&index);
    assert_int_equal(cn_pixel_store_open(&store, path), CN_OK);
    return store;
}

static float *read_photo(const cn_pixel_store *store, uint32_t photo)
{
    const cn_pixel_extent e = cn_pixel_store_extent(store, photo);
    float *rgbw = malloc((size_t)e.width * e.height * 4 * sizeof *rgbw);
    assert_int_equal(cn_pixel_store_read(store, photo, rgbw), CN_OK);
    return rgbw;
}

static void expect_near(float got, double want)
{
    assert_true(fabs((double)got - want) <= 1e-3 * fabs(want) + 1e-6);
}

static void a_grey(scratch *s, const char *name, float value, uint32_t w, uint32_t h)
{
    float *rgb = malloc((size_t)w * h * 3 * sizeof *rgb);
    for (size_t i = 0; i < (size_t)w * h * 3; i++)
        rgb[i] = value;
    assert_int_equal(cn_oiio_write_png(scratch_path(s, name), rgb, w, h, 3, NULL), CN_OK);
    free(rgb);
}

/* A picture of noise within borders of one grey, which have a little noise, as in JPEG files. */
static cn_photo_border border_of(const cn_photo_border *drawn, float grey)
{
    enum { W = 120, H = 80 };
    static float rgba[4 * W * H];
    for (uint32_t i = 0; i < W * H; i++) {
        const uint32_t x = i % W, y = i / W;
        const bool out = x < drawn->left || y < drawn->top || x >= W - drawn->right || y >= H - drawn->bottom;
        for (uint32_t c = 0; c < 3; c++) {
            const float random = cn_rng_float(5, c, i);
            rgba[4 * i + c] = out ? grey + 0.02f * (random - 0.5f) : random;
        }
        rgba[4 * i + 3] = 1;
    }
    return cn_photo_find_border(rgba, W, H);
}

static void borders_are_found(void **state)
{
    (void)state;
    const cn_photo_border cases[] = { { 4, 4, 6, 9 }, { 0, 0, 10, 10 }, { 17, 16, 0, 0 } };
    for (size_t i = 0; i < 3; i++)
        for (int white = 0; white < 2; white++) {
            const cn_photo_border found = border_of(&cases[i], (float)white);
            assert_memory_equal(&found, &cases[i], sizeof found);
        }
    /* A sky is on one side only; a picture of one grey has no border; half of a photo is no border. */
    const cn_photo_border none = { 0 }, no_border[] = { { 0, 0, 12, 0 }, { 0, 0, 80, 0 }, { 0, 0, 40, 10 } };
    for (size_t i = 0; i < 3; i++) {
        const cn_photo_border found = border_of(&no_border[i], 1);
        assert_memory_equal(&found, &none, sizeof found);
    }
}

/* The border of a photo is not learned. */
static void borders_have_no_weight(void **state)
{
    scratch *s = *state;
    enum { W = 60, H = 40 };
    float rgb[3 * W * H];
    for (uint32_t i = 0; i < W * H; i++)
        for (uint32_t c = 0; c < 3; c++)
            rgb[3 * i + c] = i / W < 5 || i / W >= H - 5 ? 0 : 0.2f + 0.6f * (float)((i * 7 + c * 3) % 11) / 11;
    assert_int_equal(cn_oiio_write_png(scratch_path(s, "bars.png"), rgb, W, H, 3, NULL), CN_OK);
    cn_pixel_store *store = build(s, W);
    float *p = read_photo(store, 0);
    for (uint32_t i = 0; i < W * H; i++)
        assert_true((p[4 * i + 3] > 0) == (i / W >= 5 && i / W < H - 5));
    free(p);
    cn_pixel_store_close(&store);
}

/* Averages are of light, not of codes: a black and white board is 0.5 in linear light. */
static void photos_are_shrunk_in_linear_light(void **state)
{
    scratch *s = *state;
    float board[64 * 64 * 3];
    for (int i = 0; i < 64 * 64; i++)
        for (int c = 0; c < 3; c++)
            board[3 * i + c] = (float)((i + i / 64) % 2);
    assert_int_equal(cn_oiio_write_png(scratch_path(s, "board.png"), board, 64, 64, 3, NULL), CN_OK);
    a_grey(s, "tiny.png", 128.0f / 255, 20, 10);
    cn_pixel_store *store = build(s, 32);
    assert_int_equal(cn_pixel_store_count(store), 2);
    assert_string_equal(cn_pixel_store_name(store, 0), "board.png");
    assert_string_equal(cn_pixel_store_name(store, 1), "tiny.png");
    const cn_pixel_extent e = cn_pixel_store_extent(store, 0), tiny = cn_pixel_store_extent(store, 1);
    assert_true(e.width == 32 && e.height == 32);
    assert_true(tiny.width == 20 && tiny.height == 10); /* never enlarged */
    float *p = read_photo(store, 0), *q = read_photo(store, 1);
    for (int i = 0; i < 32 * 32; i++)
        for (int c = 0; c < 4; c++)
            expect_near(p[4 * i + c], c < 3 ? 0.5 : 1);
    for (int i = 0; i < 200; i++)
        for (int c = 0; c < 3; c++)
            expect_near(q[4 * i + c], pow((128 / 255.0 + 0.055) / 1.055, 2.4));
    free(p);
    free(q);
    cn_pixel_store_close(&store);
    assert_null(store);
}

/* What a picture becomes depends on what its file says of its colours. */
static void float_files_keep_their_light(void **state)
{
    scratch *s = *state;
    enum { W = 32, H = 8 };
    float rgba[W * H * 4];
    for (int i = 0; i < W * H; i++) {
        const float pixel[4] = { 3, 0.5f, 0.25f, 1 };
        memcpy(rgba + 4 * i, pixel, sizeof pixel);
    }
    rgba[4 * 5] = NAN;
    rgba[4 * 7 + 1] = -INFINITY;
    const float veil[4] = { 0.75f, 0.125f, 0.0625f, 0.25f }; /* the same light, seen by a quarter */
    memcpy(rgba + 4 * 9, veil, sizeof veil);
    static const double rec709[8] = { 0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290 };
    const cn_oiio_attribute linear[] = { { "chromaticities", NULL, rec709, 8 }, { NULL, NULL, NULL, 0 } };
    assert_int_equal(cn_oiio_write_exr(scratch_path(s, "ap1.exr"), rgba, NULL, W, H, NULL), CN_OK);
    assert_int_equal(cn_oiio_write_exr(scratch_path(s, "rec709.exr"), rgba, NULL, W, H, linear), CN_OK);
    cn_pixel_store *store = build(s, 64);
    float *p = read_photo(store, 0), *q = read_photo(store, 1);
    static const double light[3] = { 3, 0.5, 0.25 };
    for (int i = 0; i < W * H; i++) {
        const bool broken = i == 5 || i == 7;
        expect_near(p[4 * i + 3], broken ? 0 : i == 9 ? 0.25 : 1);
        for (int c = 0; c < 3; c++) {
            const double *m = cn_acescg_from_srgb + 3 * c;
            expect_near(p[4 * i + c], broken ? 0 : light[c]);
            expect_near(q[4 * i + c], broken ? 0 : m[0] * light[0] + m[1] * light[1] + m[2] * light[2]);
        }
    }
    free(p);
    free(q);
    cn_pixel_store_close(&store);
}

static void masks_and_alpha_take_the_weight(void **state)
{
    scratch *s = *state;
    a_grey(s, "masked.png", 0.5f, 32, 16);
    a_grey(s, "hidden.png", 0.25f, 32, 16);
    a_grey(s, "masks/hidden.png", 0, 4, 2);
    float mask[64 * 32 * 3]; /* twice the photo's size; black on the left */
    for (int i = 0; i < 64 * 32 * 3; i++)
        mask[i] = i / 3 % 64 < 32 ? 0 : 1;
    assert_int_equal(cn_oiio_write_png(scratch_path(s, "masks/masked.png"), mask, 64, 32, 3, NULL), CN_OK);
    float cutout[32 * 16 * 4];
    for (int i = 0; i < 32 * 16 * 4; i++)
        cutout[i] = i % 4 < 3 ? 1 : i / 4 % 2 ? 1 : 0;
    assert_int_equal(cn_oiio_write_png(scratch_path(s, "cutout.png"), cutout, 32, 16, 4, NULL), CN_OK);
    cn_pixel_store *store = build(s, 16);
    float *alpha = read_photo(store, 0), *hidden = read_photo(store, 1), *masked = read_photo(store, 2);
    for (int i = 0; i < 16 * 8; i++) {
        expect_near(alpha[4 * i + 3], 0.5);
        expect_near(alpha[4 * i], 1);
        expect_near(hidden[4 * i + 3], 0);
        expect_near(masked[4 * i + 3], i % 16 < 8 ? 0 : 1);
    }
    assert_non_null(strstr(s->logged, "hidden.png is not used"));
    assert_null(strstr(s->logged, "masked.png is not used"));
    free(alpha);
    free(hidden);
    free(masked);
    cn_pixel_store_close(&store);
}

/* The photo is white where its mask is, and dark where that is black, in all ways in which it may lie on its side. */
static void a_mask_of_the_stored_pixels_is_turned(void **state)
{
    enum { W = 48, H = 32 };
    scratch *s = *state;
    float rgb[W * H * 3];
    for (int i = 0; i < W * H * 3; i++)
        rgb[i] = cn_rng_float(7, 0, (uint64_t)i / 3) < 0.5f ? 0.1f : 0.9f;
    for (int o = 1; o <= 8; o++) {
        char name[32];
        const double value = o;
        const cn_oiio_attribute attributes[] = { { "Orientation", NULL, &value, 1 }, { NULL, NULL, NULL, 0 } };
        if (o > 1 && o < 5) continue; /* of these the shape does not tell */
        snprintf(name, sizeof name, "%d.tif", o);
        rgb[0] = rgb[1] = rgb[2] = o * 0.05f; /* no two files alike */
        assert_int_equal(cn_oiio_write_tiff(scratch_path(s, name), rgb, W, H, attributes), CN_OK);
        snprintf(name, sizeof name, "masks/%d.tif.png", o);
        assert_int_equal(cn_oiio_write_png(scratch_path(s, name), rgb, W, H, 3, NULL), CN_OK);
    }
    cn_pixel_store *store = build(s, 100);
    for (uint32_t photo = 0; photo < 5; photo++) {
        float *rgbw = read_photo(store, photo);
        for (int i = 0; i < W * H; i++)
            assert_true((rgbw[4 * i + 3] > 0) == (rgbw[4 * i] > 0.3f));
        free(rgbw);
    }
    cn_pixel_store_close(&store);
}

/* A lens cap, and a renderer that wrote no number at all: what is said is the cause. A faint EXR is a picture. */
static void photos_of_nothing_are_named(void **state)
{
    scratch *s = *state;
    float nothing[32 * 16 * 4], noise[32 * 16 * 3];
    for (int i = 0; i < 32 * 16 * 4; i++)
        nothing[i] = NAN;
    for (int i = 0; i < 32 * 16 * 3; i++)
        noise[i] = cn_rng_float(3, 0, (uint64_t)i);
    a_grey(s, "cap.png", 0, 32, 16);
    float faint[32 * 16 * 4]; /* a picture in a large unit of light */
    for (int i = 0; i < 32 * 16 * 4; i++)
        faint[i] = i % 4 == 3 ? 1 : 1e-4f * cn_rng_float(4, 0, (uint64_t)i);
    assert_int_equal(cn_oiio_write_exr(scratch_path(s, "faint.exr"), faint, NULL, 32, 16, NULL), CN_OK);
    assert_int_equal(cn_oiio_write_exr(scratch_path(s, "nan.exr"), nothing, NULL, 32, 16, NULL), CN_OK);
    assert_int_equal(cn_oiio_write_png(scratch_path(s, "noise.png"), noise, 32, 16, 3, NULL), CN_OK);
    cn_pixel_store *store = build(s, 16);
    assert_non_null(strstr(s->logged, "nan.exr is not used: none of its pixels is finite"));
    assert_non_null(strstr(s->logged, "of one colour all over, such as black or white: 1 of 4. The first is cap.png"));
    cn_pixel_store_close(&store);
}

static void a_mask_of_another_shape_is_refused(void **state)
{
    scratch *s = *state;
    cn_photo_index index;
    a_grey(s, "a.png", 0.5f, 32, 16);
    a_grey(s, "masks/a.png", 1, 16, 32); /* the photo does not lie on its side */
    assert_int_equal(cn_photo_index_scan(&s->context, s->folder, &index), CN_OK);
    assert_int_equal(cn_pixel_store_build(&s->context, &index, 32, scratch_path(s, "pixels")), CN_ERR_DATA);
    assert_non_null(strstr(cn_error_message(), "masks/a.png is 16 x 32 pixels and its photo 32 x 16"));
    cn_photo_index_deinit(&index);
}

static void a_broken_mask_is_named(void **state)
{
    scratch *s = *state;
    a_grey(s, "a.png", 0.5f, 32, 16);
    assert_int_equal(cn_file_write(scratch_path(s, "masks/a.png"), "no mask", 7), CN_OK);
    cn_photo_index index;
    assert_int_equal(cn_photo_index_scan(&s->context, s->folder, &index), CN_OK);
    assert_int_equal(cn_pixel_store_build(&s->context, &index, 32, scratch_path(s, "pixels")), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "masks/a.png"));
    assert_false(cn_file_exists(scratch_path(s, "pixels")));
    cn_photo_index_deinit(&index);
}

static void gathering_finds_the_pixels_of_a_read(void **state)
{
    scratch *s = *state;
    for (unsigned i = 0; i < 3; i++) {
        char name[16];
        snprintf(name, sizeof name, "%u.tif", i);
        scratch_photo(s, name, i, NULL);
    }
    cn_pixel_store *store = build(s, 40);
    float *whole[3];
    for (uint32_t i = 0; i < 3; i++)
        whole[i] = read_photo(store, i);
    enum { N = 1000 };
    uint32_t photo[N];
    uint16_t x[N], y[N];
    float got[N * 4];
    for (uint32_t i = 0; i < N; i++) {
        const cn_pixel_extent e = cn_pixel_store_extent(store, 0);
        /* Scattered at first, then in runs that cross rows and photos. */
        const uint32_t k = i < 500 ? cn_rng_below(1, 2, i, 3 * e.width * e.height) : i;
        photo[i] = k / (e.width * e.height);
        y[i] = (uint16_t)(k / e.width % e.height);
        x[i] = (uint16_t)(k % e.width);
    }
    assert_int_equal(cn_pixel_store_gather(store, N, photo, x, y, got), CN_OK);
    const uint32_t width = cn_pixel_store_extent(store, 0).width;
    for (uint32_t i = 0; i < N; i++)
        assert_memory_equal(got + 4 * i, whole[photo[i]] + 4 * (y[i] * width + x[i]), 16);
    const uint16_t wide = 40, none = 0;
    const uint32_t first = 0, past = 3;
    assert_int_equal(cn_pixel_store_gather(store, 1, &first, &wide, &none, got), CN_ERR_INTERNAL);
    assert_int_equal(cn_pixel_store_gather(store, 1, &past, &none, &none, got), CN_ERR_INTERNAL);
    assert_int_equal(cn_pixel_store_read(store, 3, got), CN_ERR_INTERNAL);
    for (uint32_t i = 0; i < 3; i++)
        free(whole[i]);
    cn_pixel_store_close(&store);
}

static struct timespec made_at(const char *path)
{
    struct stat st;
    assert_int_equal(stat(path, &st), 0);
    return st.st_mtim;
}

/* Cells are 2.5 by 1.5 pixels. A cell hides what its pixels' left upper corners lie in, in the copy alone. */
static void hidden_cells_have_no_weight(void **state)
{
    enum { W = 80, H = 36, PIXELS = W * H };
    scratch *s = *state;
    a_grey(s, "a.png", 0.5f, W, H);
    a_grey(s, "b.png", 0.25f, W, H);
    cn_pixel_store *store = build(s, W), *copy;
    static const uint32_t cells[CN_HIDDEN_ROWS] = { [2] = 1u << 3, [CN_HIDDEN_ROWS - 1] = 1u << 31 };
    assert_int_equal(cn_pixel_store_copy(store, &copy), CN_OK);
    assert_int_equal(cn_pixel_store_hide(copy, 1, cells), CN_OK);
    assert_int_equal(cn_pixel_store_hide(copy, 2, cells), CN_ERR_INTERNAL);
    float *before = read_photo(store, 1);
    cn_pixel_store_close(&store);
    float *other = read_photo(copy, 0), *after = read_photo(copy, 1), gathered[4 * W];
    uint16_t half[4 * PIXELS], x[W], y[W];
    uint32_t photo[W];
    assert_int_equal(cn_store_read_colours(copy, 1, half), CN_OK);
    for (uint32_t row = 0; row < H; row++) {
        for (uint32_t i = 0; i < W; i++) {
            photo[i] = 1;
            x[i] = (uint16_t)i;
            y[i] = (uint16_t)row;
        }
        assert_int_equal(cn_pixel_store_gather(copy, W, photo, x, y, gathered), CN_OK);
        for (uint32_t i = 0; i < W; i++) {
            const size_t at = 4 * ((size_t)row * W + i);
            const bool hidden = (row >= 3 && row <= 4 && i >= 8 && i <= 9) || (row == 35 && i >= 78);
            assert_memory_equal(after + at, before + at, 3 * sizeof(float));
            assert_float_equal(after[at + 3], hidden ? 0 : 1, 0);
            assert_float_equal(gathered[4 * i + 3], hidden ? 0 : 1, 0);
            assert_int_equal(half[at + 3] == 0, hidden);
            assert_float_equal(other[at + 3], 1, 0);
        }
    }
    free(before);
    free(other);
    free(after);
    cn_pixel_store_close(&copy);
}

static void a_whole_store_is_left_alone_and_its_photos_used_again(void **state)
{
    scratch *s = *state;
    scratch_photo(s, "a.tif", 1, NULL);
    scratch_photo(s, "b.tif", 2, NULL);
    cn_pixel_store *store = build(s, 32);
    float *before = read_photo(store, 1);
    cn_pixel_store_close(&store);
    const struct timespec first = made_at(scratch_path(s, "work/pixels"));
    store = build(s, 32);
    cn_pixel_store_close(&store);
    const struct timespec second = made_at(scratch_path(s, "work/pixels"));
    assert_memory_equal(&first, &second, sizeof first);
    /* A new photo; the old ones' files cannot be read any more between index and store, and need not be. */
    scratch_photo(s, "aa.tif", 3, NULL);
    cn_photo_index index;
    assert_int_equal(cn_photo_index_scan(&s->context, s->folder, &index), CN_OK);
    assert_int_equal(unlink(scratch_path(s, "b.tif")), 0);
    const char *path = scratch_path(s, "work/pixels");
    assert_int_equal(cn_pixel_store_build(&s->context, &index, 32, path), CN_OK);
    assert_int_equal(cn_pixel_store_open(&store, path), CN_OK);
    assert_int_equal(cn_pixel_store_count(store), 3);
    assert_string_equal(cn_pixel_store_name(store, 2), "b.tif");
    float *after = read_photo(store, 2);
    const cn_pixel_extent e = cn_pixel_store_extent(store, 2);
    assert_memory_equal(before, after, (size_t)e.width * e.height * 16);
    cn_pixel_store_close(&store);
    /* Another width needs the photo; without it the store that was there stays. */
    assert_int_equal(cn_pixel_store_build(&s->context, &index, 24, path), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), "b.tif"));
    assert_int_equal(cn_pixel_store_open(&store, path), CN_OK);
    cn_pixel_store_close(&store);
    cn_photo_index_deinit(&index);
    free(before);
    free(after);
}

static int stop;
static void stop_at_half(void *user, const cn_progress_report *r)
{
    (void)user;
    stop = r->done >= r->total / 2;
}

static void a_stopped_build_goes_on_where_it_was(void **state)
{
    scratch *s = *state;
    for (unsigned i = 0; i < 16; i++) {
        char name[16];
        snprintf(name, sizeof name, "%02u.tif", i);
        scratch_photo(s, name, i, NULL);
    }
    cn_photo_index index;
    assert_int_equal(cn_photo_index_scan(&s->context, s->folder, &index), CN_OK);
    char path[256], part[300];
    snprintf(path, sizeof path, "%s", scratch_path(s, "pixels"));
    snprintf(part, sizeof part, "%s.part", path);
    cn_context context = s->context;
    context.progress = stop_at_half;
    context.stop = &stop;
    stop = 0;
    assert_int_equal(cn_pixel_store_build(&context, &index, 32, path), CN_ERR_INTERRUPTED);
    assert_non_null(strstr(cn_error_message(), "8 of 16 kept"));
    assert_false(cn_file_exists(path));
    assert_true(cn_file_exists(part));
    /* The first half is not decoded again: its files may be gone. */
    for (int i = 0; i < 8; i++)
        assert_int_equal(unlink(scratch_path(s, index.photos[i].name)), 0);
    assert_int_equal(cn_pixel_store_build(&s->context, &index, 32, path), CN_OK);
    assert_false(cn_file_exists(part));
    cn_pixel_store *store;
    assert_int_equal(cn_pixel_store_open(&store, path), CN_OK);
    assert_int_equal(cn_pixel_store_count(store), 16);
    cn_pixel_store_close(&store);
    cn_photo_index_deinit(&index);
}

/* Changes bytes of the store; size 0 cuts it there. */
static cn_status open_changed(scratch *s, size_t at, const void *bytes, size_t size)
{
    char *data;
    size_t total;
    cn_pixel_store *store;
    assert_int_equal(cn_file_read(scratch_path(s, "work/pixels"), 0, &data, &total), CN_OK);
    if (size) memcpy(data + at, bytes, size);
    const char *path = scratch_path(s, "bad");
    assert_int_equal(cn_file_write(path, data, size ? total : at), CN_OK);
    free(data);
    const cn_status status = cn_pixel_store_open(&store, path);
    if (status != CN_OK) {
        assert_null(store);
        assert_non_null(strstr(cn_error_message(), "/bad"));
        assert_non_null(strstr(cn_error_message(), "delete"));
    } else {
        cn_pixel_store_close(&store);
    }
    return status;
}

static void damaged_stores_are_refused(void **state)
{
    scratch *s = *state;
    scratch_photo(s, "a.tif", 1, NULL);
    scratch_photo(s, "b.tif", 2, NULL);
    cn_pixel_store *store = build(s, 32);
    const size_t last = store->records[1].offset + cn_store_pixel_bytes(&store->records[1]);
    cn_pixel_store_close(&store);
    static const uint64_t many = UINT64_MAX / 512, odd = 4097, far = UINT64_MAX & ~UINT64_C(4095), inside = 0;
    static const uint32_t wide = 60000, none = 0;
    static const uint16_t newer = CN_STORE_VERSION + 1;
    const size_t record = sizeof(cn_store_header);
    char endless[CN_STORE_NAME_SIZE];
    memset(endless, 'a', sizeof endless);
    assert_int_equal(open_changed(s, 0, "C", 1), CN_OK);
    assert_int_equal(open_changed(s, 0, "X", 1), CN_ERR_FORMAT);
    assert_int_equal(open_changed(s, offsetof(cn_store_header, version), &newer, 2), CN_ERR_VERSION);
    assert_int_equal(open_changed(s, offsetof(cn_store_header, n_photos), &many, 8), CN_ERR_FORMAT);
    const uint64_t *const offsets[] = { &odd, &far, &inside };
    for (int i = 0; i < 3; i++)
        assert_int_equal(open_changed(s, record + offsetof(cn_store_record, offset), offsets[i], 8), CN_ERR_FORMAT);
    assert_int_equal(open_changed(s, record + offsetof(cn_store_record, width), &wide, 4), CN_ERR_FORMAT);
    assert_int_equal(open_changed(s, record + offsetof(cn_store_record, height), &none, 4), CN_ERR_FORMAT);
    assert_int_equal(open_changed(s, record + offsetof(cn_store_record, name), endless, sizeof endless), CN_ERR_FORMAT);
    const size_t cuts[] = { 0, 10, 64, 600, 5000, last - 1 };
    for (size_t i = 0; i < sizeof cuts / sizeof *cuts; i++)
        assert_int_equal(open_changed(s, cuts[i], NULL, 0), CN_ERR_FORMAT);
    assert_int_equal(cn_pixel_store_open(&store, scratch_path(s, "missing")), CN_ERR_IO);
}

static void a_damaged_store_is_made_again(void **state)
{
    scratch *s = *state;
    scratch_photo(s, "a.tif", 1, NULL);
    cn_pixel_store *store = build(s, 32);
    cn_pixel_store_close(&store);
    scratch_copy(s, "work/pixels", "work/pixels", 0.5);
    store = build(s, 32);
    cn_pixel_store_close(&store);
    assert_non_null(strstr(s->logged, "is damaged"));
}

static void what_cannot_be_written_is_said(void **state)
{
    scratch *s = *state;
    scratch_photo(s, "a.tif", 1, NULL);
    cn_photo_index index;
    assert_int_equal(cn_photo_index_scan(&s->context, s->folder, &index), CN_OK);
    char path[256];
    snprintf(path, sizeof path, "%s/no/such/pixels", s->folder);
    assert_int_equal(cn_pixel_store_build(&s->context, &index, 32, path), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), path));
    assert_int_equal(cn_pixel_store_build(&s->context, &index, 3, scratch_path(s, "pixels")), CN_ERR_CONFIG);
    assert_non_null(strstr(cn_error_message(), "width_px"));
    cn_photo_index_deinit(&index);
}

/* A user's own OpenColorIO config is for what is shown, not for what is stored. */
static void the_store_does_not_depend_on_ocio(void **state)
{
    scratch *s = *state;
    a_grey(s, "a.png", 1, 32, 16);
    setenv("OCIO", "/no/such/config.ocio", 1);
    cn_pixel_store *store = build(s, 32);
    unsetenv("OCIO");
    cn_pixel_store_close(&store);
}

#define TEST(f) cmocka_unit_test_setup_teardown(f, scratch_set_up, scratch_tear_down)
int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(borders_are_found),
        TEST(borders_have_no_weight),
        TEST(photos_are_shrunk_in_linear_light),
        TEST(float_files_keep_their_light),
        TEST(masks_and_alpha_take_the_weight),
        TEST(photos_of_nothing_are_named),
        TEST(a_mask_of_the_stored_pixels_is_turned),
        TEST(a_mask_of_another_shape_is_refused),
        TEST(a_broken_mask_is_named),
        TEST(gathering_finds_the_pixels_of_a_read),
        TEST(hidden_cells_have_no_weight),
        TEST(a_whole_store_is_left_alone_and_its_photos_used_again),
        TEST(a_stopped_build_goes_on_where_it_was),
        TEST(damaged_stores_are_refused),
        TEST(a_damaged_store_is_made_again),
        TEST(what_cannot_be_written_is_said),
        TEST(the_store_does_not_depend_on_ocio),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
