#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/rng.h"
#include "image/image.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static float *noise(uint32_t w, uint32_t h, bool weighted)
{
    float *p = malloc((size_t)w * h * 4 * sizeof *p);
    for (uint32_t i = 0; i < w * h * 4; i++)
        p[i] = i % 4 < 3 || weighted ? cn_rng_float(1, w, i) : 1;
    return p;
}

/* The light that a picture sends: colour x weight x area of a pixel. */
static void light(const float *p, uint32_t w, uint32_t h, double sum[4])
{
    memset(sum, 0, 4 * sizeof *sum);
    for (size_t i = 0; i < (size_t)w * h; i++) {
        for (int c = 0; c < 3; c++)
            sum[c] += (double)p[4 * i + (size_t)c] * (double)p[4 * i + 3] / (w * h);
        sum[3] += (double)p[4 * i + 3] / (w * h);
    }
}

static void light_and_weight_are_kept(void **state)
{
    (void)state;
    static const uint32_t sizes[][4] = {
        { 64, 48, 32, 24 }, { 61, 47, 20, 15 }, { 100, 3, 33, 2 }, { 7, 7, 7, 7 }, { 31, 17, 1, 1 }
    };
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++)
        for (int weighted = 0; weighted < 2; weighted++) {
            const uint32_t *d = sizes[s];
            float *in = noise(d[0], d[1], weighted), *out = malloc((size_t)d[2] * d[3] * 4 * sizeof *out);
            cn_image_shrink(in, d[0], d[1], out, d[2], d[3]);
            double before[4], after[4];
            light(in, d[0], d[1], before);
            light(out, d[2], d[3], after);
            for (int c = 0; c < 4; c++)
                assert_true(fabs(before[c] - after[c]) < 1e-6);
            free(in);
            free(out);
        }
}

static void the_same_size_is_the_same_picture(void **state)
{
    (void)state;
    float *in = noise(13, 9, false), out[13 * 9 * 4];
    cn_image_shrink(in, 13, 9, out, 13, 9);
    for (int i = 0; i < 13 * 9 * 4; i++)
        assert_true(fabsf(in[i] - out[i]) < 1e-7f);
    free(in);
}

/* Three pixels to two: the middle one is shared by halves. */
static void borders_count_by_what_they_cover(void **state)
{
    (void)state;
    const float in[12] = { 3, 0, 0, 1, 6, 0, 0, 1, 9, 0, 0, 1 };
    float out[8];
    cn_image_shrink(in, 3, 1, out, 2, 1);
    assert_true(fabsf(out[0] - 4) < 1e-6f && fabsf(out[4] - 8) < 1e-6f);
    assert_true(fabsf(out[3] - 1) < 1e-6f && fabsf(out[7] - 1) < 1e-6f);
}

static void masked_and_broken_pixels_add_nothing(void **state)
{
    (void)state;
    const float in[32] = { 1, 2, 3, 1, 100,      100, 100, 0, NAN, 1, 1, 1, 1, 2, 3, 0.5f,
                           5, 5, 5, 0, INFINITY, 0,   0,   1, 5,   5, 5, 0, 5, 5, 5, NAN };
    float out[8];
    cn_image_shrink(in, 4, 2, out, 2, 1);
    assert_true(fabsf(out[0] - 1) < 1e-6f && fabsf(out[1] - 2) < 1e-6f && fabsf(out[2] - 3) < 1e-6f);
    assert_true(fabsf(out[3] - 0.25f) < 1e-6f);
    assert_true(fabsf(out[4] - 1) < 1e-6f && fabsf(out[7] - 0.125f) < 1e-6f);
    const float gone[4] = { 1, 1, 1, 0 };
    cn_image_shrink(gone, 1, 1, out, 1, 1);
    for (int c = 0; c < 4; c++)
        assert_float_equal(out[c], 0, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(light_and_weight_are_kept),
        cmocka_unit_test(the_same_size_is_the_same_picture),
        cmocka_unit_test(borders_count_by_what_they_cover),
        cmocka_unit_test(masked_and_broken_pixels_add_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
