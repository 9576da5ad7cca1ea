/* Compares the reference with finite differences: the encoding by its table, and the whole field by weights and
 * encoding. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../unit/field/options.h"
#include "field/field.h"
#include "guard.h"

#include <math.h>
#include <stdlib.h>

static void test_encode_gradient(void **state)
{
    (void)state;
    const cn_level level = { .resolution = 9, .entries = 1u << 8, .hashed = true };
    enum { STRIDE = 2 * CN_PANEL };
    float pos[3 * CN_PANEL], out[STRIDE], dout[STRIDE], grad[512] = { 0 };
    uint32_t table[256] = { 0 };
    fill_random(pos, 3 * CN_PANEL, 0, 1, 1);
    fill_random(dout, STRIDE, -1, 1, 2);
    cn_kernel_ref.encode_backward(&level,
                                  &(cn_encode_gradient){ pos, dout, STRIDE, 1, &(cn_range){ 0, 256 }, grad, NULL });
    /* The encoding is linear in the table: a table with a 1 at one place gives that place's derivative exactly. */
    for (int i = 0; i < 512; i += 5) {
        memset(table, 0, sizeof table);
        table[i / 2] = (uint32_t)cn_bf16_from_float(1) << (i % 2 ? 16 : 0);
        cn_kernel_ref.encode(&level, table, pos, 1, out, STRIDE);
        double sum = 0;
        for (int j = 0; j < STRIDE; j++)
            sum += (double)out[j] * dout[j];
        assert_true(fabs(sum - grad[i]) < 1e-4 + 1e-4 * fabs(sum));
    }
}

typedef struct rig {
    cn_field field;
    cn_arena arena;
    cn_field_acts acts, d;
    float *weights, *transposed, *d_logit, *dw, *dout;
} rig;

enum { PANELS = 2 };

static double loss(rig *r)
{
    const cn_field_params params = { NULL, r->weights, r->transposed, 0, NULL };
    r->field.type->prepare(&r->field, r->weights, r->transposed);
    r->field.type->density_pass(&r->field, &cn_kernel_ref, &params, &r->acts, PANELS);
    r->field.type->colour_pass(&r->field, &cn_kernel_ref, &params, &r->acts, PANELS);
    double sum = 0;
    for (size_t p = 0; p < PANELS; p++) {
        for (size_t i = 0; i < 4 * CN_PANEL; i++)
            sum += (double)r->acts.out[p * 4 * CN_PANEL + i] * r->dout[p * 4 * CN_PANEL + i];
        for (size_t i = 0; i < CN_PANEL; i++)
            sum += (double)r->acts.in[p * r->field.colour_in * CN_PANEL + i] * r->d_logit[p * CN_PANEL + i];
    }
    return sum;
}

static void make_rig(rig *r)
{
    const cn_field_options config = hash_options((hash_sizes){ .levels = 4,
                                                               .log2_table = 8,
                                                               .base_resolution = 4,
                                                               .finest_resolution = 32,
                                                               .density_width = 16,
                                                               .colour_width = 12 });
    assert_int_equal(cn_field_layout(&r->field, &config, (cn_field_inputs){ .n = 5 }), CN_OK);
    assert_int_equal(cn_arena_init(&r->arena, 4 << 20), CN_OK);
    r->field.type->acts_take(&r->field, &r->arena, PANELS, &r->acts);
    r->field.type->acts_take(&r->field, &r->arena, PANELS, &r->d);
    r->weights = CN_ARENA_NEW(&r->arena, float, r->field.n_weights);
    r->transposed = CN_ARENA_NEW(&r->arena, float, r->field.n_weights);
    r->dw = CN_ARENA_NEW(&r->arena, float, r->field.n_weights);
    r->d_logit = CN_ARENA_NEW(&r->arena, float, PANELS *CN_PANEL);
    r->dout = CN_ARENA_NEW(&r->arena, float, PANELS * 4 * CN_PANEL);
    float *table = calloc(2 * r->field.entries, sizeof *table);
    r->field.type->init(&r->field, 3, table, r->weights);
    free(table);
    fill_random(r->acts.enc, (size_t)PANELS * r->field.enc_rows * CN_PANEL, -1, 1, 4);
    fill_random(r->acts.in, (size_t)PANELS * r->field.colour_in * CN_PANEL, -1, 1, 5);
    fill_random(r->d_logit, PANELS * CN_PANEL, -1, 1, 6);
    fill_random(r->dout, PANELS * 4 * CN_PANEL, -1, 1, 7);
}

/* Central difference; ReLU corners make a few values jump, so a share of them may be off. */
static void check(rig *r, float *x, const float *gradient, size_t n, size_t stride)
{
    size_t bad = 0, all = 0;
    for (size_t i = 0; i < n; i += stride, all++) {
        const float kept = x[i], h = 2e-3f;
        x[i] = kept + h;
        const double above = loss(r);
        x[i] = kept - h;
        const double below = loss(r);
        x[i] = kept;
        const double numeric = (above - below) / (2 * (double)h);
        if (!(fabs(numeric - gradient[i]) < 2e-2 + 2e-2 * fabs(numeric))) bad++;
    }
    if (bad * 20 > all) fail_msg("%zu of %zu gradients differ from finite differences", bad, all);
}

static void test_field_gradient(void **state)
{
    (void)state;
    rig r = { 0 };
    make_rig(&r);
    (void)loss(&r);
    const cn_field_params params = { NULL, r.weights, r.transposed, 0, NULL };
    memcpy(r.d.out, r.dout, sizeof(float) * PANELS * 4 * CN_PANEL);
    r.field.type->backward(&r.field, &cn_kernel_ref, &params, &r.acts, &(cn_field_gradient){ &r.d, r.d_logit, r.dw },
                           PANELS);
    check(&r, r.weights, r.dw, r.field.n_weights, 3);
    check(&r, r.acts.enc, r.d.enc, (size_t)PANELS * r.field.enc_rows * CN_PANEL, 11);
    cn_arena_deinit(&r.arena);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_encode_gradient),
        cmocka_unit_test(test_field_gradient),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
