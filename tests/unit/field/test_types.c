/* Every type of field in the list: gradients against finite differences, options, blocks; and the gradient of the
 * contraction. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/rng.h"
#include "field/field.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { PANELS = 2 };

static float uniform(unsigned stream, size_t i)
{
    return cn_rng_float(5, stream, i);
}

/* A small field of a type. */
static void small_field(const cn_field_type *type, cn_field *field)
{
    cn_field_options options;
    assert_int_equal(cn_field_options_preset(type->name, CN_QUALITY_PREVIEW, &options), CN_OK);
    for (uint32_t i = 0; i < type->n_options; i++) {
        const char *name = type->options[i].name;
        if (strcmp(name, "levels") == 0) options.value[i] = 4;
        if (strcmp(name, "log2_table") == 0) options.value[i] = 10;
        if (strcmp(name, "base_resolution") == 0) options.value[i] = 4;
        if (strcmp(name, "finest_resolution") == 0) options.value[i] = 24;
        if (strstr(name, "_width")) options.value[i] = 8;
    }
    assert_int_equal(cn_field_layout(field, &options, 5), CN_OK);
}

/* Parameters of a field, and activations for PANELS panels. */
typedef struct rig {
    cn_field field;
    cn_arena arena;
    uint32_t *table;
    float *weights, *derived, *pos, *dw;
    cn_field_acts acts, d;
    float logit[PANELS * CN_PANEL], d_logit[PANELS * CN_PANEL], d_out[PANELS * 4 * CN_PANEL];
} rig;

static void rig_init(rig *r, const cn_field_type *type)
{
    small_field(type, &r->field);
    assert_int_equal(cn_arena_init(&r->arena, 16 << 20), CN_OK);
    r->table = CN_ARENA_NEW(&r->arena, uint32_t, r->field.entries + 1);
    r->weights = CN_ARENA_NEW(&r->arena, float, r->field.n_weights + 1);
    r->dw = CN_ARENA_NEW(&r->arena, float, r->field.n_weights + 1);
    r->derived = CN_ARENA_NEW(&r->arena, float, r->field.n_derived + 1);
    r->pos = CN_ARENA_NEW(&r->arena, float, PANELS * 3 * CN_PANEL);
    type->acts_take(&r->field, &r->arena, PANELS, &r->acts);
    type->acts_take(&r->field, &r->arena, PANELS, &r->d);
    float *first = calloc(2 * r->field.entries + 1, sizeof *first);
    assert_non_null(first);
    type->init(&r->field, 3, first, r->weights);
    free(first);
    for (size_t i = 0; i < r->field.entries; i++)
        r->table[i] = cn_bf16_from_float(2 * uniform(1, i) - 1) | (uint32_t)cn_bf16_from_float(2 * uniform(2, i) - 1)
                                                                      << 16;
    for (size_t i = 0; i < PANELS * 3 * CN_PANEL; i++)
        r->pos[i] = 0.05f + 0.9f * uniform(3, i);
    for (size_t i = 0; i < PANELS * CN_PANEL; i++)
        r->d_logit[i] = 2 * uniform(4, i) - 1;
    for (size_t i = 0; i < PANELS * 4 * CN_PANEL; i++)
        r->d_out[i] = i / CN_PANEL % 4 == 3 ? 0 : 2 * uniform(5, i) - 1;
    for (size_t i = 0; i < PANELS * CN_PANEL; i++)
        for (size_t c = 0; c < r->field.conditioning; c++)
            r->acts.in[(i / CN_PANEL * r->field.colour_in + CN_GEO + c) * CN_PANEL + i % CN_PANEL] =
                2 * uniform(6, 64 * i + c) - 1;
}

/* What all passes forward make of the parameters, times given gradients: a number to take differences of. */
static double value(rig *r)
{
    const cn_field_type *type = r->field.type;
    const cn_field_params params = { r->table, r->weights, r->derived };
    double sum = 0;
    type->prepare(&r->field, r->weights, r->derived);
    for (uint32_t e = 0; e < r->field.n_encoders; e++)
        type->encode(&r->field, &cn_kernel_ref, r->table, e, r->pos, PANELS, r->acts.enc);
    type->logits(&r->field, &cn_kernel_ref, &params, &r->d, r->acts.enc, PANELS, r->logit);
    type->density_pass(&r->field, &cn_kernel_ref, &params, &r->acts, PANELS);
    type->colour_pass(&r->field, &cn_kernel_ref, &params, &r->acts, PANELS);
    for (size_t i = 0; i < PANELS * CN_PANEL; i++)
        sum += (double)r->logit[i] * (double)r->d_logit[i];
    for (size_t i = 0; i < PANELS * 4 * CN_PANEL; i++)
        sum += (double)r->acts.out[i] * (double)r->d_out[i];
    return sum;
}

static void backward(rig *r)
{
    const cn_field_params params = { r->table, r->weights, r->derived };
    (void)value(r);
    memset(r->dw, 0, r->field.n_weights * sizeof *r->dw);
    memcpy(r->d.out, r->d_out, sizeof r->d_out);
    r->field.type->backward(&r->field, &cn_kernel_ref, &params, &r->acts, &r->d, r->d_logit, PANELS, r->dw);
}

/* ReLU and cells have corners, where a difference says nothing: nine of ten values must agree. */
static void expect_most(uint32_t good, uint32_t all, const char *type, const char *what)
{
    print_message("%s, %s: %u of %u gradients as by differences\n", type, what, good, all);
    assert_true(all > 20 && good >= 0.9 * all);
}

static bool near(double numeric, double gradient)
{
    return fabs(numeric - gradient) < 0.02 + 0.02 * fabs(numeric);
}

static void gradients_of_weights(rig *r)
{
    uint32_t good = 0, all = 0;
    backward(r);
    for (size_t i = 0; i < r->field.n_weights; i += 7) {
        const float kept = r->weights[i], h = 1e-3f;
        r->weights[i] = kept + h;
        const double above = value(r);
        r->weights[i] = kept - h;
        const double numeric = (above - value(r)) / (2 * (double)h);
        r->weights[i] = kept;
        good += near(numeric, (double)r->dw[i]);
        all++;
    }
    expect_most(good, all, r->field.type->name, "weights");
}

static float feature(const rig *r, size_t i)
{
    return cn_bf16_to_float((uint16_t)(r->table[i / 2] >> (i % 2 ? 16 : 0)));
}

static void set_feature(rig *r, size_t i, float x)
{
    const uint32_t shift = i % 2 ? 16 : 0;
    r->table[i / 2] = (r->table[i / 2] & ~(0xffffu << shift)) | (uint32_t)cn_bf16_from_float(x) << shift;
}

static void gradients_of_the_table(rig *r)
{
    const cn_field *f = &r->field;
    uint32_t good = 0, all = 0;
    float *grad = calloc(2 * f->entries + 1, sizeof *grad);
    assert_non_null(grad);
    backward(r);
    for (uint32_t s = 0; s < f->n_sections; s++) {
        const cn_range range = { 0, f->section[s].entries };
        uint8_t *touched = calloc(range.count / CN_TOUCH + 1, 1);
        const cn_encode_gradient in = { r->pos, r->d.enc, (size_t)f->enc_rows * CN_PANEL,
                                        PANELS, &range,   grad + 2 * (size_t)f->section[s].first,
                                        touched };
        f->type->encode_backward(f, &cn_kernel_ref, s, &in);
        free(touched);
    }
    for (size_t i = 0; i < 2 * f->entries; i++) {
        if (fabsf(grad[i]) < 0.02f || all > 400) continue;
        const float kept = feature(r, i);
        set_feature(r, i, kept + 0.03125f);
        const double above = value(r), high = (double)feature(r, i);
        set_feature(r, i, kept - 0.03125f);
        const double numeric = (above - value(r)) / (high - (double)feature(r, i));
        set_feature(r, i, kept);
        good += near(numeric, (double)grad[i]);
        all++;
    }
    if (f->entries) expect_most(good, all, f->type->name, "table");
    free(grad);
}

static void gradients_of_places(rig *r)
{
    enum { SAMPLES = PANELS * CN_PANEL };
    float d_pos[SAMPLES][3];
    uint32_t good = 0, all = 0;
    backward(r);
    r->field.type->position_gradient(&r->field, r->table, r->pos, r->d.enc, SAMPLES, d_pos);
    for (size_t i = 0; i < SAMPLES; i++)
        for (size_t a = 0; a < 3; a++) {
            float *x = &r->pos[(i / CN_PANEL * 3 + a) * CN_PANEL + i % CN_PANEL];
            const float kept = *x, h = 2e-4f;
            *x = kept + h;
            const double above = value(r), high = (double)*x;
            *x = kept - h;
            const double numeric = (above - value(r)) / (high - (double)*x);
            *x = kept;
            good += fabs(numeric - (double)d_pos[i][a]) < 0.1 + 0.03 * fabs(numeric);
            all++;
        }
    expect_most(good, all, r->field.type->name, "places");
}

static void test_gradients(void **state)
{
    (void)state;
    for (uint32_t t = 0; t < cn_field_n_types; t++) {
        rig *r = calloc(1, sizeof *r);
        assert_non_null(r);
        rig_init(r, cn_field_types[t]);
        gradients_of_weights(r);
        gradients_of_the_table(r);
        gradients_of_places(r);
        cn_arena_deinit(&r->arena);
        free(r);
    }
}

static void test_density_gradients(void **state)
{
    (void)state;
    for (uint32_t t = 0; t < cn_field_n_types; t++)
        for (float x = -12; x < 14; x += 0.37f) {
            const cn_density_activation a = cn_field_types[t]->density;
            const double up = (double)cn_density(a, x + 1e-2f), down = (double)cn_density(a, x - 1e-2f);
            const double numeric = (up - down) / ((double)(x + 1e-2f) - (double)(x - 1e-2f));
            const float density = cn_density(a, x);
            assert_true(density > 0 && isfinite(density) && isfinite(cn_density(a, 1e30f)));
            assert_true(fabs(numeric - (double)cn_density_gradient(a, x, density)) < 1e-6 + 2e-2 * numeric);
        }
}

/* Every parameter has its place in one block, and a block's tensor has a name of its own. */
static void test_blocks_cover_the_parameters(void **state)
{
    (void)state;
    for (uint32_t t = 0; t < cn_field_n_types; t++) {
        cn_field field;
        size_t table = 0, weights = 0;
        small_field(cn_field_types[t], &field);
        for (uint32_t b = 0; b < field.n_blocks; b++) {
            const cn_field_block *block = &field.block[b];
            const bool is_table = block->storage == CN_FIELD_TABLE;
            assert_true(block->offset == (is_table ? table : weights));
            *(is_table ? &table : &weights) += is_table ? block->dims[0] : block->dims[0] * block->dims[1];
            for (uint32_t c = 0; c < b; c++)
                assert_string_not_equal(block->name, field.block[c].name);
        }
        assert_true(table == field.entries && weights == field.n_weights);
        size_t sections = 0;
        for (uint32_t s = 0; s < field.n_sections; s++) {
            assert_true(field.section[s].first == sections);
            sections += field.section[s].entries;
        }
        assert_true(sections == field.entries && field.enc_rows % 4 == 0 && field.colour_in % 4 == 0);
    }
}

static void test_options(void **state)
{
    (void)state;
    cn_field_options options;
    cn_field field;
    for (uint32_t t = 0; t < cn_field_n_types; t++) {
        const cn_field_type *type = cn_field_types[t];
        assert_true(cn_field_type_find(type->name) == type && type->n_options <= CN_FIELD_OPTIONS_MAX);
        for (int q = 0; q < CN_QUALITIES; q++) {
            assert_int_equal(cn_field_options_preset(type->name, (cn_quality)q, &options), CN_OK);
            assert_int_equal(cn_field_layout(&field, &options, 16), CN_OK);
            assert_true(cn_field_options_bytes(&options) > 0);
        }
        for (uint32_t i = 0; i < type->n_options; i++) {
            const cn_field_option *o = &type->options[i];
            assert_int_equal(cn_field_options_set(&options, o->name, o->least), CN_OK);
            assert_true(cn_field_options_get(&options, o->name) == o->least);
            assert_int_equal(cn_field_options_set(&options, o->name, o->most + 1), CN_ERR_CONFIG);
            assert_int_equal(cn_field_options_set(&options, o->name, NAN), CN_ERR_CONFIG);
            assert_non_null(strstr(cn_error_message(), o->name));
        }
        assert_int_equal(cn_field_options_set(&options, "no_such_setting", 1), CN_ERR_CONFIG);
    }
    assert_int_equal(cn_field_options_preset("cloud", CN_QUALITY_HIGH, &options), CN_ERR_CONFIG);
    assert_non_null(strstr(cn_error_message(), "hash, dense"));
    assert_int_equal(cn_field_options_preset("dense", CN_QUALITY_HIGH, &options), CN_OK);
    assert_int_equal(cn_field_options_set(&options, "log2_table", 12), CN_ERR_CONFIG);
    assert_non_null(strstr(cn_error_message(), "is a setting of hash, not of dense"));
}

static void test_contraction(void **state)
{
    (void)state;
    for (size_t i = 0; i < 200; i++) {
        float x[3], g[3], d_x[3];
        for (size_t a = 0; a < 3; a++)
            x[a] = 6 * uniform(6, 3 * i + a) - 3, g[a] = 2 * uniform(7, 3 * i + a) - 1;
        cn_field_uncontract_gradient(x, g, d_x);
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
        cmocka_unit_test(test_gradients),
        cmocka_unit_test(test_density_gradients),
        cmocka_unit_test(test_blocks_cover_the_parameters),
        cmocka_unit_test(test_options),
        cmocka_unit_test(test_contraction),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
