/* The encoding's slope against finite differences of the encoding, and the contraction's against those of the march's
 * placing. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/rng.h"
#include "field/field.h"

#include <math.h>
#include <stdlib.h>

enum { SAMPLES = 60, PANELS = 2 };

static float uniform(unsigned stream, size_t i)
{
    return cn_rng_float(5, stream, i);
}

/* Sum of the encoding times d_enc at the given positions. */
static double value(const cn_field *f, const uint32_t *table, const float *pos, const float *d_enc, float *enc)
{
    double sum = 0;
    for (uint32_t l = 0; l < f->config.levels; l++)
        cn_field_encode_level(f, &cn_kernel_ref, table, l, pos, PANELS, enc);
    for (size_t i = 0; i < PANELS * f->enc_rows * CN_PANEL; i++)
        sum += (double)enc[i] * (double)d_enc[i];
    return sum;
}

static void test_slope_is_the_difference(void **state)
{
    (void)state;
    const cn_field_config config = { .levels = 6,
                                     .log2_table = 10,
                                     .base_resolution = 4,
                                     .finest_resolution = 64,
                                     .density_width = 8,
                                     .colour_width = 8 };
    cn_field f;
    assert_int_equal(cn_field_layout(&f, &config), CN_OK);
    uint32_t *table = calloc(f.entries, sizeof *table);
    float *enc = calloc(PANELS * f.enc_rows * CN_PANEL, sizeof *enc),
          *d_enc = calloc(PANELS * f.enc_rows * CN_PANEL, sizeof *d_enc);
    float pos[PANELS * 3 * CN_PANEL] = { 0 }, d_pos[SAMPLES][3];
    assert_true(table && enc && d_enc);
    for (size_t i = 0; i < f.entries; i++)
        table[i] = cn_bf16_from_float(2 * uniform(1, i) - 1) | (uint32_t)cn_bf16_from_float(2 * uniform(2, i) - 1)
                                                                   << 16;
    for (size_t i = 0; i < SAMPLES; i++) {
        for (size_t a = 0; a < 3; a++)
            pos[(i / CN_PANEL * 3 + a) * CN_PANEL + i % CN_PANEL] = 0.05f + 0.9f * uniform(3, 3 * i + a);
        for (size_t r = 0; r < 2 * config.levels; r++)
            d_enc[(i / CN_PANEL * f.enc_rows + r) * CN_PANEL + i % CN_PANEL] = 2 * uniform(4, 64 * i + r) - 1;
    }
    cn_field_slope(&f, table, pos, d_enc, SAMPLES, d_pos);
    uint32_t checked = 0;
    for (size_t i = 0; i < SAMPLES; i++)
        for (size_t a = 0; a < 3; a++) {
            float *x = &pos[(i / CN_PANEL * 3 + a) * CN_PANEL + i % CN_PANEL];
            const float kept = *x, h = 1e-4f;
            /* A difference across a cell's border says nothing. */
            bool border = false;
            for (uint32_t l = 0; l < config.levels; l++) {
                const float R = (float)f.level[l].resolution;
                border = border || floorf((kept - h) * R + 0.5f) != floorf((kept + h) * R + 0.5f);
            }
            if (border) continue;
            *x = kept + h;
            const double above = value(&f, table, pos, d_enc, enc), high = (double)*x;
            *x = kept - h;
            const double numeric = (above - value(&f, table, pos, d_enc, enc)) / (high - (double)*x);
            *x = kept;
            assert_true(fabs(numeric - (double)d_pos[i][a]) < 0.05 + 0.01 * fabs(numeric));
            checked++;
        }
    assert_true(checked > SAMPLES);
    free(table), free(enc), free(d_enc);
}

static void test_contraction(void **state)
{
    (void)state;
    for (size_t i = 0; i < 200; i++) {
        float x[3], g[3], d_x[3];
        for (size_t a = 0; a < 3; a++)
            x[a] = 6 * uniform(6, 3 * i + a) - 3, g[a] = 2 * uniform(7, 3 * i + a) - 1;
        cn_field_uncontract_slope(x, g, d_x);
        for (int a = 0; a < 3; a++) {
            double sum[2];
            for (int side = 0; side < 2; side++) {
                float moved[3] = { x[0], x[1], x[2] }, t = 1, length, pos[3 * CN_PANEL] = { 0 };
                moved[a] += side ? 1e-3f : -1e-3f;
                const cn_box_ray ray = { { moved[0], moved[1], moved[2] }, { 0, 0, 0 } };
                cn_kernel_ref.place(&ray, &t, 1, 0.01f, 1, 0, pos, &length);
                sum[side] = 0;
                for (size_t b = 0; b < 3; b++)
                    sum[side] += (double)g[b] * (double)pos[b * CN_PANEL];
            }
            const double numeric = (sum[1] - sum[0]) / 2e-3;
            if (fabs(fabs(x[0]) - 1) < 2e-3 || fabs(fabs(x[1]) - 1) < 2e-3 || fabs(fabs(x[2]) - 1) < 2e-3) continue;
            assert_true(fabs(numeric - (double)d_x[a]) < 2e-3 + 0.02 * fabs(numeric));
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_slope_is_the_difference),
        cmocka_unit_test(test_contraction),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
