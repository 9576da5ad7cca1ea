/* Pixels in and out: formats, orientation, damage. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "bridge/oiio.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { W = 40, H = 24 };
static char folder[] = "/tmp/conurb-oiio-XXXXXX";
static float rgb[W * H * 3], rgba[W * H * 4], depth[W * H];

static int set_up(void **state)
{
    (void)state;
    for (int i = 0; i < W * H; i++) {
        for (int c = 0; c < 4; c++)
            rgba[4 * i + c] = c == 3 ? 1 : (float)((i % W) * (c + 1) + (i / W) * 3) / 255;
        memcpy(&rgb[3 * i], &rgba[4 * i], 3 * sizeof(float));
        depth[i] = 1.0f / 3 + (float)i * 1000.1f;
    }
    return mkdtemp(folder) ? 0 : -1;
}
static int tear_down(void **state)
{
    (void)state;
    return folder_remove(folder);
}

static const char *file(const char *name)
{
    static char path[128];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

static void expect_pixels(const char *path, const float *want, int channels, float tolerance)
{
    float *got;
    uint32_t w, h;
    assert_int_equal(cn_oiio_read_rgba(path, &got, &w, &h), CN_OK);
    assert_int_equal(w, W);
    assert_int_equal(h, H);
    for (int i = 0; i < W * H; i++)
        for (int c = 0; c < 4; c++) {
            const float x = c < channels ? want[channels * i + c] : 1;
            assert_true(fabsf(got[4 * i + c] - x) <= tolerance);
        }
    free(got);
}

static void png_keeps_eight_bits(void **state)
{
    (void)state;
    assert_int_equal(cn_oiio_write_png(file("a.png"), rgb, W, H, 3, NULL), CN_OK);
    expect_pixels(file("a.png"), rgb, 3, 1e-6f);
}

static void png_clamps_and_blackens_nan(void **state)
{
    (void)state;
    const float in[12] = { -1, 2, NAN, INFINITY, -INFINITY, 0.5f, 0, 1, 0, 0, 0, 0 };
    const float want[12] = { 0, 1, 0, 1, 0, 128.0f / 255, 0, 1, 0, 0, 0, 0 };
    assert_int_equal(cn_oiio_write_png(file("c.png"), in, 2, 2, 3, NULL), CN_OK);
    float *got;
    uint32_t w, h;
    assert_int_equal(cn_oiio_read_rgba(file("c.png"), &got, &w, &h), CN_OK);
    for (int i = 0; i < 4; i++)
        for (int c = 0; c < 3; c++)
            assert_true(fabsf(got[4 * i + c] - want[3 * i + c]) < 1e-6f);
    free(got);
}

static void colours_under_alpha_stay(void **state)
{
    (void)state;
    static float half_seen[W * H * 4];
    memcpy(half_seen, rgba, sizeof half_seen);
    for (int i = 0; i < W * H; i++)
        half_seen[4 * i + 3] = i % 2 ? 51.0f / 255 : 0;
    assert_int_equal(cn_oiio_write_png(file("alpha.png"), half_seen, W, H, 4, NULL), CN_OK);
    float *got;
    uint32_t w, h;
    assert_int_equal(cn_oiio_read_rgba(file("alpha.png"), &got, &w, &h), CN_OK);
    for (int i = 1; i < W * H; i += 2)
        for (int c = 0; c < 4; c++)
            assert_true(fabsf(got[4 * i + c] - half_seen[4 * i + c]) < 1e-5f);
    free(got);
}

static void tiff_keeps_sixteen_bits(void **state)
{
    (void)state;
    assert_int_equal(cn_oiio_write_tiff(file("a.tif"), rgb, W, H, NULL), CN_OK);
    expect_pixels(file("a.tif"), rgb, 3, 1e-5f);
    cn_oiio_info info;
    assert_int_equal(cn_oiio_read_info(file("a.tif"), &info), CN_OK);
    assert_false(info.is_float);
}

static void exr_keeps_half_colours_and_says_acescg(void **state)
{
    (void)state;
    assert_int_equal(cn_oiio_write_exr(file("a.exr"), rgba, depth, W, H, NULL), CN_OK);
    expect_pixels(file("a.exr"), rgba, 4, 1e-3f);
    cn_oiio_info info;
    assert_int_equal(cn_oiio_read_info(file("a.exr"), &info), CN_OK);
    assert_true(info.is_float);
    assert_int_equal(info.channels, 5);
    assert_string_equal(info.colour_space, "ACEScg");
    assert_int_equal(cn_oiio_write_exr(file("b.exr"), rgba, NULL, W, H, NULL), CN_OK);
    expect_pixels(file("b.exr"), rgba, 4, 1e-3f);
}

static void exr_stays_within_half(void **state)
{
    (void)state;
    const float in[8] = { 1e9f, INFINITY, 65504, 1, 0.25f, NAN, 1e-3f, 1 };
    assert_int_equal(cn_oiio_write_exr(file("big.exr"), in, NULL, 2, 1, NULL), CN_OK);
    float *got;
    uint32_t w, h;
    assert_int_equal(cn_oiio_read_rgba(file("big.exr"), &got, &w, &h), CN_OK);
    for (int c = 0; c < 3; c++)
        assert_float_equal(got[c], 65504, 0);
    assert_true(isnan(got[5]));
    free(got);
}

/* EXIF: 1 as is, 2 mirrored, 3 turned by 180, 4 flipped, 5 transposed, 6 to be turned clockwise, 7 transverse,
 * 8 anticlockwise. */
static void all_orientations_are_applied(void **state)
{
    (void)state;
    for (int o = 1; o <= 8; o++) {
        const double value = o;
        const cn_oiio_attribute attributes[] = { { "Orientation", NULL, &value, 1 }, { NULL, NULL, NULL, 0 } };
        assert_int_equal(cn_oiio_write_tiff(file("turned.tif"), rgb, W, H, attributes), CN_OK);
        float *got;
        uint32_t w, h, checked_w, checked_h;
        cn_oiio_info info;
        assert_int_equal(cn_oiio_read_info(file("turned.tif"), &info), CN_OK);
        assert_int_equal(info.orientation, o);
        assert_int_equal(info.width, W);
        assert_int_equal(cn_oiio_read_rgba(file("turned.tif"), &got, &w, &h), CN_OK);
        assert_int_equal(cn_oiio_check(file("turned.tif"), &checked_w, &checked_h), CN_OK);
        assert_int_equal(w, o < 5 ? W : H);
        assert_int_equal(h, o < 5 ? H : W);
        assert_int_equal(checked_w, w);
        assert_int_equal(checked_h, h);
        for (uint32_t y = 0; y < h; y++)
            for (uint32_t x = 0; x < w; x++) {
                /* Where an upright pixel lies in the file. */
                const uint32_t from_x[9] = { 0, x, W - 1 - x, W - 1 - x, x, y, y, W - 1 - y, W - 1 - y };
                const uint32_t from_y[9] = { 0, y, y, H - 1 - y, H - 1 - y, x, H - 1 - x, H - 1 - x, x };
                const float *want = &rgb[3 * (from_y[o] * W + from_x[o])];
                for (int c = 0; c < 3; c++)
                    assert_true(fabsf(got[4 * (y * w + x) + (uint32_t)c] - want[c]) < 1e-4f);
            }
        free(got);
    }
}

static void cut(const char *from, const char *to, double share)
{
    char *data, source[128];
    size_t size;
    snprintf(source, sizeof source, "%s", file(from));
    assert_int_equal(cn_file_read(source, 0, &data, &size), CN_OK);
    assert_int_equal(cn_file_write(file(to), data, (size_t)((double)size * share)), CN_OK);
    free(data);
}

/* The leak checker, where one is linked. OpenImageIO 2.4 loses a string a truncated PNG: its read callback makes libpng
 * jump past the destructor. */
void __lsan_disable(void) __attribute__((weak));
void __lsan_enable(void) __attribute__((weak));
static void forgive_leaks(bool forgive)
{
    if (forgive && __lsan_disable) __lsan_disable();
    if (!forgive && __lsan_enable) __lsan_enable();
}

static void truncated_files_are_refused(void **state)
{
    (void)state;
    enum { SIDE = 256 };
    float *noise = malloc(SIDE * SIDE * 4 * sizeof *noise);
    for (uint32_t i = 0; i < SIDE * SIDE * 4; i++)
        noise[i] = (float)(i * 2654435761u >> 24) / 255;
    assert_int_equal(cn_oiio_write_jpeg(file("n.jpg"), noise, SIDE, SIDE, NULL), CN_OK);
    assert_int_equal(cn_oiio_write_png(file("n.png"), noise, SIDE, SIDE, 3, NULL), CN_OK);
    assert_int_equal(cn_oiio_write_tiff(file("n.tif"), noise, SIDE, SIDE, NULL), CN_OK);
    assert_int_equal(cn_oiio_write_exr(file("n.exr"), noise, NULL, SIDE, SIDE, NULL), CN_OK);
    free(noise);
    static const char *const whole[] = { "n.jpg", "n.png", "n.tif", "n.exr" };
    static const char *const part[] = { "cut.jpg", "cut.png", "cut.tif", "cut.exr" };
    static const double shares[] = { 0.95, 0.5, 0.02, 0 };
    for (int i = 0; i < 4; i++) {
        uint32_t w, h;
        assert_int_equal(cn_oiio_check(file(whole[i]), &w, &h), CN_OK);
        for (int k = 0; k < 4; k++) {
            cut(whole[i], part[i], shares[k]);
            float *got;
            if (i == 1) forgive_leaks(true);
            assert_int_equal(cn_oiio_check(file(part[i]), &w, &h), CN_ERR_FORMAT);
            assert_non_null(strstr(cn_error_message(), part[i]));
            assert_int_equal(cn_oiio_read_rgba(file(part[i]), &got, &w, &h), CN_ERR_FORMAT);
            assert_null(got);
            if (i == 1) forgive_leaks(false);
        }
    }
}

/* Writes the file anew with `more` extraneous bytes before its end, and the last three bytes of its SOS header, which
 * a sequential JPEG has as 0, 63, 0, all zero where `zeroed`. */
static void spoil(const char *name, const char *to, bool zeroed, size_t more)
{
    char *data, source[128];
    size_t size, i = 2;
    snprintf(source, sizeof source, "%s", file(name));
    assert_int_equal(cn_file_read(source, 0, &data, &size), CN_OK);
    while (i + 10 < size && !((unsigned char)data[i] == 0xff && (unsigned char)data[i + 1] == 0xda))
        i++;
    const size_t last = i + 1 + (unsigned char)data[i + 3];
    assert_int_equal(data[last - 1], 63);
    if (zeroed) memset(data + last - 2, 0, 3);
    char *spoilt = calloc(size + more, 1);
    memcpy(spoilt, data, size - 2);
    memcpy(spoilt + size - 2 + more, data + size - 2, 2);
    assert_int_equal(cn_file_write(file(to), spoilt, size + more), CN_OK);
    free(spoilt);
    free(data);
}

/* Phones and panorama cameras write JPEGs that libjpeg warns of, and decodes completely. */
static void a_jpeg_with_warnings_is_read(void **state)
{
    (void)state;
    float *want, *got;
    uint32_t w, h;
    assert_int_equal(cn_oiio_write_jpeg(file("good.jpg"), rgb, W, H, NULL), CN_OK);
    assert_int_equal(cn_oiio_read_rgba(file("good.jpg"), &want, &w, &h), CN_OK);
    for (int i = 0; i < 2; i++) {
        spoil("good.jpg", "warned.jpg", i == 0, i == 1 ? 7 : 0);
        assert_int_equal(cn_oiio_check(file("warned.jpg"), &w, &h), CN_OK);
        assert_int_equal(cn_oiio_read_rgba(file("warned.jpg"), &got, &w, &h), CN_OK);
        assert_memory_equal(got, want, sizeof *got * 4 * W * H);
        free(got);
        /* libjpeg passes on its first warning only, and not that the file ends too early. */
        cut("warned.jpg", "cut.jpg", 0.9);
        assert_int_equal(cn_oiio_check(file("cut.jpg"), &w, &h), CN_ERR_FORMAT);
        assert_non_null(strstr(cn_error_message(), "cut.jpg"));
    }
    free(want);
}

/* Bytes of the picture that are lost: no code, or the end of the picture, comes too early. */
static void a_jpeg_with_lost_bytes_is_refused(void **state)
{
    (void)state;
    char *data, *broken;
    size_t size;
    uint32_t w, h;
    assert_int_equal(cn_oiio_write_jpeg(file("good.jpg"), rgb, W, H, NULL), CN_OK);
    assert_int_equal(cn_file_read(file("good.jpg"), 0, &data, &size), CN_OK);
    broken = malloc(size);
    memcpy(broken, data, size);
    for (size_t i = size / 10 * 9; i < size - 20; i += 2) /* stuffed bytes: ones, which are no code */
        memcpy(broken + i, "\xff\x00", 2);
    assert_int_equal(cn_file_write(file("code.jpg"), broken, size), CN_OK);
    assert_int_equal(cn_oiio_check(file("code.jpg"), &w, &h), CN_ERR_FORMAT);
    memcpy(broken, data, size);
    memcpy(broken + size / 10 * 9, "\xff\xd9", 2);
    assert_int_equal(cn_file_write(file("early.jpg"), broken, size), CN_OK);
    assert_int_equal(cn_oiio_check(file("early.jpg"), &w, &h), CN_ERR_FORMAT);
    free(broken);
    free(data);
}

static void a_huge_claim_fails_before_it_takes_memory(void **state)
{
    (void)state;
    /* A JPEG's frame header: FF C0, length, 8 bits, height, width. */
    char *data;
    size_t size;
    assert_int_equal(cn_oiio_write_jpeg(file("claim.jpg"), rgb, W, H, NULL), CN_OK);
    assert_int_equal(cn_file_read(file("claim.jpg"), 0, &data, &size), CN_OK);
    bool found = false;
    for (size_t i = 0; i + 9 < size && !found; i++)
        if ((unsigned char)data[i] == 0xff && (unsigned char)data[i + 1] == 0xc0) {
            memset(data + i + 5, 0xf0, 4);
            found = true;
        }
    assert_true(found);
    assert_int_equal(cn_file_write(file("claim.jpg"), data, size), CN_OK);
    free(data);
    uint32_t w, h;
    assert_int_equal(cn_oiio_check(file("claim.jpg"), &w, &h), CN_ERR_FORMAT);
}

static void what_is_no_picture_is_named(void **state)
{
    (void)state;
    cn_oiio_info info;
    assert_int_equal(cn_oiio_read_info(file("missing.jpg"), &info), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), "missing.jpg"));
    assert_int_equal(cn_file_write(file("text.jpg"), "not a picture", 13), CN_OK);
    assert_int_equal(cn_oiio_read_info(file("text.jpg"), &info), CN_ERR_FORMAT);
    assert_non_null(strstr(cn_error_message(), "text.jpg"));
}

static void failed_writes_are_said(void **state)
{
    (void)state;
    assert_int_equal(cn_oiio_write_png(file("no/such/a.png"), rgb, W, H, 3, NULL), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), "a.png"));
    assert_int_equal(cn_oiio_write_exr(file("no/such/a.exr"), rgba, NULL, W, H, NULL), CN_ERR_IO);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(png_keeps_eight_bits),
        cmocka_unit_test(png_clamps_and_blackens_nan),
        cmocka_unit_test(colours_under_alpha_stay),
        cmocka_unit_test(tiff_keeps_sixteen_bits),
        cmocka_unit_test(exr_keeps_half_colours_and_says_acescg),
        cmocka_unit_test(exr_stays_within_half),
        cmocka_unit_test(all_orientations_are_applied),
        cmocka_unit_test(truncated_files_are_refused),
        cmocka_unit_test(a_jpeg_with_warnings_is_read),
        cmocka_unit_test(a_jpeg_with_lost_bytes_is_refused),
        cmocka_unit_test(a_huge_claim_fails_before_it_takes_memory),
        cmocka_unit_test(what_is_no_picture_is_named),
        cmocka_unit_test(failed_writes_are_said),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
