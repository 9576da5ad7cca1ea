#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "conurb/measure.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define assert_near(value, want, tolerance) assert_true(fabs((double)(value) - (want)) <= (tolerance))

static void psnr_of_a_known_difference(void **state)
{
    (void)state;
    float truth[6] = { 0.5f, 0.5f, 0.5f, 0, 0, 0 }, test[6] = { 0.6f, 0.6f, 0.6f, 0, 0, 0 }, weight[2] = { 1, 0 };
    assert_near(cn_measure_psnr(truth, test, weight, 2), 20, 1e-5); /* mse 0.01 */
    assert_near(cn_measure_psnr(truth, test, NULL, 2), 20 + 10 * log10(2), 1e-5);
    assert_true(isinf(cn_measure_psnr(truth, truth, NULL, 2)));
    weight[0] = 0;
    assert_true(isnan(cn_measure_psnr(truth, test, weight, 2)));
    assert_true(isnan(cn_measure_psnr(truth, test, NULL, 0)));
}

static void psnr_weights_are_relative(void **state)
{
    (void)state;
    float truth[6] = { 0 }, test[6] = { 0.1f, 0.1f, 0.1f, 0.3f, 0.3f, 0.3f }, weight[2] = { 3, 1 };
    assert_near(cn_measure_psnr(truth, test, weight, 2), -10 * log10((3 * 0.01 + 0.09) / 4), 1e-5);
}

static void fill(float *rgb, uint32_t width, uint32_t height, unsigned seed)
{
    for (size_t i = 0; i < (size_t)3 * width * height; i++) {
        seed = seed * 1664525u + 1013904223u;
        rgb[i] = (float)(seed >> 8) / 16777216.0f;
    }
}

static void ssim_of_equal_pictures_is_one(void **state)
{
    (void)state;
    float a[3 * 20 * 13];
    fill(a, 20, 13, 1);
    assert_near(cn_measure_ssim(a, a, NULL, 20, 13), 1, 1e-12);
}

/* Flat pictures have no variance: SSIM is the luminance term alone, (2ab + C1) / (aa + bb + C1). */
static void ssim_of_flat_pictures(void **state)
{
    (void)state;
    float a[3 * 11 * 11], b[3 * 11 * 11];
    for (int i = 0; i < 3 * 11 * 11; i++) {
        a[i] = 0.25f;
        b[i] = 0.75f;
    }
    assert_near(cn_measure_ssim(a, b, NULL, 11, 11), (2 * 0.1875 + 1e-4) / (0.0625 + 0.5625 + 1e-4), 1e-9);
}

/* The whole two-dimensional window, summed plainly. */
static double ssim_plain(const float *a, const float *b, uint32_t width, uint32_t height)
{
    double sum = 0;
    size_t n = 0;
    for (int c = 0; c < 3; c++)
        for (uint32_t y = 5; y + 5 < height; y++)
            for (uint32_t x = 5; x + 5 < width; x++, n++) {
                double w = 0, ma = 0, mb = 0, va = 0, vb = 0, vab = 0;
                for (int pass = 0; pass < 2; pass++)
                    for (int j = -5; j <= 5; j++)
                        for (int i = -5; i <= 5; i++) {
                            double g = exp(-(i * i + j * j) / 4.5);
                            size_t at = 3 * ((size_t)((int)y + j) * width + (size_t)((int)x + i)) + (size_t)c;
                            if (pass == 0) {
                                w += g;
                                ma += g * a[at];
                                mb += g * b[at];
                            } else {
                                double da = a[at] - ma / w, db = b[at] - mb / w;
                                va += g * da * da / w;
                                vb += g * db * db / w;
                                vab += g * da * db / w;
                            }
                        }
                ma /= w;
                mb /= w;
                sum += (2 * ma * mb + 1e-4) * (2 * vab + 9e-4) / ((ma * ma + mb * mb + 1e-4) * (va + vb + 9e-4));
            }
    return sum / (double)n;
}

static void ssim_agrees_with_the_plain_sum(void **state)
{
    (void)state;
    float a[3 * 17 * 14], b[3 * 17 * 14];
    fill(a, 17, 14, 1);
    fill(b, 17, 14, 2);
    for (int i = 0; i < 3 * 17 * 14; i++)
        b[i] = 0.5f * a[i] + 0.4f * b[i];
    double got = cn_measure_ssim(a, b, NULL, 17, 14), want = ssim_plain(a, b, 17, 14);
    assert_near(got, want, 1e-9);
    assert_true(got > 0.1 && got < 0.95);
}

static void ssim_counts_windows_by_their_centre(void **state)
{
    (void)state;
    float a[3 * 12 * 11], b[3 * 12 * 11], weight[12 * 11] = { 0 }, left[3 * 11 * 11], right[3 * 11 * 11];
    fill(a, 12, 11, 3);
    fill(b, 12, 11, 4);
    assert_true(isnan(cn_measure_ssim(a, b, weight, 12, 11)));
    weight[5 * 12 + 5] = 1; /* centre of the left one of the two windows */
    for (int y = 0; y < 11; y++) {
        memcpy(left + 33 * y, a + 36 * y, sizeof(float) * 33);
        memcpy(right + 33 * y, b + 36 * y, sizeof(float) * 33);
    }
    assert_near(cn_measure_ssim(a, b, weight, 12, 11), cn_measure_ssim(left, right, NULL, 11, 11), 1e-12);
    assert_true(isnan(cn_measure_ssim(a, b, NULL, 10, 11)));
    assert_true(isnan(cn_measure_ssim(a, b, NULL, 11, 10)));
}

static void side_by_side_lays_out_truth_test_error(void **state)
{
    (void)state;
    float truth[6] = { 0, 0, 0, 0.5f, 0.5f, 0.5f }, test[6] = { 0, 0, 0, 1, 1, 1 }, out[18];
    cn_measure_side_by_side(truth, test, 1, 2, out);
    float want[18] = { 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.5f, 0.5f, 0.5f, 1, 1, 1, 1, 1, 1 };
    for (int i = 0; i < 18; i++)
        assert_near(out[i], want[i], 1e-6);
}

static void eval_deinit_is_safe_twice(void **state)
{
    (void)state;
    cn_eval eval = { .photos = calloc(1, sizeof(cn_eval_photo)), .n_photos = 1 };
    assert_non_null(eval.photos);
    eval.photos[0].name = strdup("a.jpg");
    cn_eval_deinit(&eval);
    assert_null(eval.photos);
    cn_eval_deinit(&eval);
}

static void colour_correction_undoes_an_affine_change(void **state)
{
    (void)state;
    enum { N = 400 };
    static float truth[3 * N], test[3 * N], out[3 * N], weight[N];
    fill(truth, N, 1, 7);
    for (size_t i = 0; i < N; i++) {
        const float *t = truth + 3 * i;
        test[3 * i] = 0.5f * t[0] + 0.1f * t[1] + 0.05f;
        test[3 * i + 1] = 0.6f * t[1] + 0.1f;
        test[3 * i + 2] = 0.4f * t[2] + 0.1f * t[0];
        weight[i] = i % 4 ? 1 : 0;
        if (!(i % 4)) test[3 * i] = 0.9f; /* does not count */
    }
    cn_measure_colour_correct(truth, test, weight, N, out);
    const double before = cn_measure_psnr(truth, test, weight, N), after = cn_measure_psnr(truth, out, weight, N);
    assert_true(before < 20 && after > 50);
    /* A picture of one colour has no affine change to find, and stays finite. */
    for (size_t i = 0; i < 3 * N; i++)
        test[i] = 0.5f;
    cn_measure_colour_correct(truth, test, NULL, N, out);
    for (size_t i = 0; i < 3 * N; i++)
        assert_true(out[i] >= 0 && out[i] <= 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(psnr_of_a_known_difference),
        cmocka_unit_test(psnr_weights_are_relative),
        cmocka_unit_test(ssim_of_equal_pictures_is_one),
        cmocka_unit_test(ssim_of_flat_pictures),
        cmocka_unit_test(ssim_agrees_with_the_plain_sum),
        cmocka_unit_test(ssim_counts_windows_by_their_centre),
        cmocka_unit_test(side_by_side_lays_out_truth_test_error),
        cmocka_unit_test(eval_deinit_is_safe_twice),
        cmocka_unit_test(colour_correction_undoes_an_affine_change),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
