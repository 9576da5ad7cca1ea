/* Goes over every type of field in the list. Its passes agree with each other, and its gradients with finite
 * differences. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/rng.h"
#include "small.h"

enum { PANELS = 2, SAMPLES = PANELS * CN_PANEL, DIRECTIONS = 16, WANTED = DIRECTIONS + 5 };

typedef struct rig {
    cn_field field;
    cn_arena arena;
    cn_field_acts acts, d;
    cn_field_params params;
    uint32_t *table;
    float *weights, *derived, *dw, *conditioning;
    bool prior; /* the loss is the type's own (prior_loss) */
    float pos[PANELS * 3 * CN_PANEL], d_logit[SAMPLES], d_out[4 * SAMPLES], visible[SAMPLES];
} rig;

static const cn_kernel *const kernel = &cn_kernel_ref;

static float uniform(unsigned stream, size_t i)
{
    return 2 * cn_rng_float(11, stream, i) - 1;
}

static void carve(rig *r, cn_arena *arena)
{
    const cn_field *f = &r->field;
    f->type->acts_take(f, arena, PANELS, &r->acts);
    f->type->acts_take(f, arena, PANELS, &r->d);
    r->table = CN_ARENA_NEW(arena, uint32_t, f->entries + 1);
    r->weights = CN_ARENA_NEW(arena, float, f->n_weights + 1);
    r->derived = CN_ARENA_NEW(arena, float, f->n_derived + 1);
    r->dw = CN_ARENA_NEW(arena, float, f->n_weights + 1);
    r->conditioning = CN_ARENA_NEW(arena, float, (size_t)SAMPLES * f->conditioning + 1);
}

static uint32_t pair_of(float a, float b)
{
    return cn_bf16_from_float(a) | (uint32_t)cn_bf16_from_float(b) << 16;
}

/* A type that places its own entries gets points about the samples. */
static void place_entries(rig *r)
{
    static float points[4 * SAMPLES][3];
    for (size_t i = 0; i < 4 * SAMPLES; i++)
        for (size_t a = 0; a < 3; a++)
            points[i][a] =
                r->pos[(i / 4 / CN_PANEL * 3 + a) * CN_PANEL + i / 4 % CN_PANEL] + 0.05f * uniform(6, 3 * i + a);
    const cn_field_change change = { .seed = 3, .table = r->table, .points = points, .n_points = 4 * SAMPLES };
    r->field.type->place(&r->field, &change);
}

/* A table of larger values than those that training starts with. */
static void rig_init(rig *r, const cn_field_type *type)
{
    memset(r, 0, sizeof *r);
    const cn_field_options options = small_field(type, 24);
    if (cn_field_layout(&r->field, &options, (cn_field_inputs){ WANTED, DIRECTIONS }) != CN_OK)
        fail_msg("%s: %s", type->name, cn_error_message());
    cn_arena counter;
    cn_arena_count(&counter);
    carve(r, &counter);
    assert_int_equal(cn_arena_init(&r->arena, counter.used), CN_OK);
    carve(r, &r->arena);
    float *first = calloc(2 * r->field.entries + 1, sizeof *first);
    assert_non_null(first);
    type->init(&r->field, 3, first, r->weights);
    for (size_t i = 0; i < r->field.entries; i++) {
        const bool fixed = i >= r->field.entries - r->field.fixed;
        r->table[i] = fixed ? pair_of(first[2 * i], first[2 * i + 1])
                            : pair_of(0.5f * uniform(1, 2 * i), 0.5f * uniform(1, 2 * i + 1));
    }
    free(first);
    for (size_t i = 0; i < (size_t)SAMPLES * r->field.conditioning; i++)
        r->conditioning[i] = uniform(2, i);
    for (size_t i = 0; i < sizeof r->pos / sizeof *r->pos; i++)
        r->pos[i] = 0.5f + 0.45f * uniform(3, i);
    if (type->place) place_entries(r);
    for (size_t i = 0; i < SAMPLES; i++)
        r->d_logit[i] = uniform(4, i);
    for (size_t i = 0; i < 4 * SAMPLES; i++)
        r->d_out[i] = i / CN_PANEL % 4 == 3 ? 0 : uniform(5, i); /* row 3 of the colour is padding */
    r->params = (cn_field_params){ r->table, r->weights, r->derived, 0, NULL };
}

static void rig_deinit(rig *r)
{
    cn_arena_deinit(&r->arena);
}

static void encode(const rig *r, size_t first, size_t n_panels, float *enc)
{
    const cn_field *f = &r->field;
    for (uint32_t e = 0; e < f->n_encoders; e++)
        f->type->encode(f, kernel, e,
                        &(cn_field_encoding){ r->table, r->pos + first * 3 * CN_PANEL, n_panels,
                                              enc + first * f->enc_rows * CN_PANEL });
}

static void forward(rig *r)
{
    const cn_field *f = &r->field;
    encode(r, 0, PANELS, r->acts.enc);
    f->type->prepare(f, r->weights, r->derived);
    f->type->density_pass(f, kernel, &r->params, &r->acts, PANELS);
    for (size_t p = 0; p < PANELS; p++)
        memcpy(r->acts.in + (p * f->colour_in + f->geo_rows) * CN_PANEL,
               r->conditioning + p * f->conditioning * CN_PANEL, sizeof(float) * f->conditioning * CN_PANEL);
    f->type->colour_pass(f, kernel, &r->params, &r->acts, PANELS);
}

/* A linear function of logits and colours. */
static double loss(rig *r)
{
    forward(r);
    if (r->prior) return r->field.type->prior_loss(&r->field, kernel, &r->params, &r->acts, PANELS);
    double sum = 0;
    for (size_t p = 0; p < PANELS; p++) {
        for (size_t i = 0; i < 4 * CN_PANEL; i++)
            sum += (double)r->acts.out[p * 4 * CN_PANEL + i] * (double)r->d_out[p * 4 * CN_PANEL + i];
        for (size_t i = 0; i < CN_PANEL; i++)
            sum += (double)r->acts.in[p * r->field.colour_in * CN_PANEL + i] * (double)r->d_logit[p * CN_PANEL + i];
    }
    return sum;
}

static void backward(rig *r)
{
    forward(r);
    memset(r->dw, 0, sizeof(float) * r->field.n_weights);
    memcpy(r->d.out, r->d_out, sizeof r->d_out);
    r->field.type->backward(&r->field, kernel, &r->params, &r->acts, &(cn_field_gradient){ &r->d, r->d_logit, r->dw },
                            PANELS);
}

/* The checks of one kind of gradient. Where a unit switches or a cell ends, the differences to both sides are not the
 * same, and the gradient has to be that of one side. A few gradients are neither, because both sides have such a
 * kink. */
typedef struct tally {
    const char *type, *what;
    double scale; /* root mean square of these gradients */
    uint32_t checked, unclear;
    size_t all; /* their number, where it is less than 20 */
} tally;

static void compare(tally *t, double below, double above, double analytic)
{
    const double numeric = 0.5 * (below + above), most = 0.02 * fabs(numeric) + 0.01 * t->scale;
    if (fmin(fabs(below - analytic), fabs(above - analytic)) <= most)
        t->checked++;
    else if (fabs(below - above) > most)
        t->unclear++;
    else
        fail_msg("%s, %s: gradient %g, by finite differences %g", t->type, t->what, analytic, numeric);
}

static void conclude(const tally *t)
{
    print_message("%s, %s: %u gradients as differences say, %u unclear\n", t->type, t->what, t->checked, t->unclear);
    assert_true(t->scale > 0);
    assert_true(t->checked >= (t->all ? t->all : 20) && t->checked >= 8 * t->unclear);
}

/* Differences to both sides of a float that the loss depends on. */
static void differ(rig *r, tally *t, float *x, float h, double analytic)
{
    const float kept = *x;
    const double here = loss(r);
    *x = kept + h;
    const double above = (loss(r) - here) / ((double)*x - (double)kept);
    *x = kept - h;
    const double below = (loss(r) - here) / ((double)*x - (double)kept);
    *x = kept;
    compare(t, below, above, analytic);
}

static double rms(const float *x, size_t n)
{
    double sum = 0;
    size_t some = 0;
    for (size_t i = 0; i < n; i++)
        if (x[i] != 0) sum += (double)x[i] * (double)x[i], some++;
    return some ? sqrt(sum / (double)some) : 0;
}

/* About 60 of every block of weights. */
static void weights_in(rig *r)
{
    backward(r);
    for (uint32_t b = 0; b < r->field.n_blocks; b++) {
        const cn_field_block *block = &r->field.block[b];
        const size_t n = block->dims[0] * block->dims[1];
        if (block->storage != CN_FIELD_WEIGHTS) continue;
        tally t = { r->field.type->name, block->name, rms(r->dw + block->offset, n), 0, 0, n < 20 ? n : 0 };
        if (r->prior && !(t.scale > 0)) continue; /* the type's own loss does not depend on these */
        for (size_t i = 0; i < n; i += n / 60 + 1)
            differ(r, &t, r->weights + block->offset + i, 3e-4f, (double)r->dw[block->offset + i]);
        conclude(&t);
    }
}

static void weights_of(const cn_field_type *type)
{
    rig r;
    rig_init(&r, type);
    weights_in(&r);
    rig_deinit(&r);
}

/* Like differ, for one of a pair of bfloat16. It uses the step as it is after rounding. */
static void differ_pair(rig *r, tally *t, size_t i, double analytic)
{
    uint16_t *x = (uint16_t *)(void *)r->table + i;
    const uint16_t kept = *x;
    const float value = cn_bf16_to_float(kept);
    const double here = loss(r);
    double side[2];
    for (int s = 0; s < 2; s++) {
        *x = cn_bf16_from_float(value + (s ? 1.0f : -1.0f) / 256);
        const double step = (double)cn_bf16_to_float(*x) - (double)value;
        assert_true(step != 0);
        side[s] = (loss(r) - here) / step;
        *x = kept;
    }
    if (analytic == 0) {
        assert_true(side[0] == 0 && side[1] == 0);
        return;
    }
    compare(t, side[0], side[1], analytic);
}

static void section_of(rig *r, uint32_t s)
{
    const cn_field_section *section = &r->field.section[s];
    const cn_range all = { 0, section->entries };
    float *grad = calloc(2 * (size_t)section->entries, sizeof *grad);
    uint8_t *touched = calloc(section->entries / CN_TOUCH + 1, 1);
    assert_true(grad && touched);
    const cn_encode_gradient in = {
        r->pos, r->d.enc, (size_t)r->field.enc_rows * CN_PANEL, PANELS, &all, grad, touched
    };
    r->field.type->encode_backward(&r->field, kernel, r->table, s, &in);
    tally t = { r->field.type->name, "table", rms(grad, 2 * (size_t)section->entries), 0, 0, 0 };
    size_t with = 0, seen = 0;
    for (size_t i = 0; i < 2 * (size_t)section->entries; i++) {
        with += grad[i] != 0;
        if (grad[i] != 0) assert_int_equal(touched[i / 2 / CN_TOUCH], 1);
    }
    for (size_t i = 0; i < 2 * (size_t)section->entries; i++)
        if (grad[i] != 0 && seen++ % (with / 40 + 1) == 0)
            differ_pair(r, &t, 2 * (size_t)section->first + i, (double)grad[i]);
        else if (grad[i] == 0 && i % (2 * (size_t)section->entries / 20 + 1) == 0)
            differ_pair(r, &t, 2 * (size_t)section->first + i, 0);
    /* Where the type's own loss does not depend on the section, only the zeros are compared. */
    if (!r->prior || t.scale > 0) conclude(&t);

    /* A part of the section gets the same gradients as the whole. */
    const uint32_t first = section->entries / 2 / CN_TOUCH * CN_TOUCH;
    const cn_range half = { first, section->entries - first };
    float *part = calloc(2 * (size_t)half.count, sizeof *part);
    assert_non_null(part);
    cn_encode_gradient of_half = in;
    of_half.range = &half;
    of_half.grad = part;
    of_half.touched = NULL;
    r->field.type->encode_backward(&r->field, kernel, r->table, s, &of_half);
    assert_memory_equal(part, grad + 2 * (size_t)first, 2 * sizeof(float) * half.count);
    free(part);
    free(grad);
    free(touched);
}

static void table_of(const cn_field_type *type)
{
    rig r;
    rig_init(&r, type);
    backward(&r);
    for (uint32_t s = 0; s < r.field.n_sections; s++)
        section_of(&r, s);
    rig_deinit(&r);
}

static void position_of(const cn_field_type *type)
{
    rig r;
    static float d_pos[SAMPLES][3];
    rig_init(&r, type);
    backward(&r);
    memset(d_pos, 0x7f, sizeof d_pos); /* it is overwritten */
    type->position_gradient(&r.field, r.table, r.pos, r.d.enc, SAMPLES, d_pos);
    tally t = { type->name, "position", rms(&d_pos[0][0], SAMPLES * 3), 0, 0, 0 };
    for (size_t i = 0; i < SAMPLES; i++)
        for (size_t a = 0; a < 3; a++)
            differ(&r, &t, &r.pos[(i / CN_PANEL * 3 + a) * CN_PANEL + i % CN_PANEL], 1e-4f, (double)d_pos[i][a]);
    conclude(&t);
    rig_deinit(&r);
}

/* Gradients of the values that condition the colour. They are the same with and without gradients of weights. */
static void conditioning_of(const cn_field_type *type)
{
    rig r;
    rig_init(&r, type);
    const cn_field *f = &r.field;
    assert_true(f->conditioning >= WANTED);
    assert_int_equal(f->colour_in, f->geo_rows + f->conditioning);
    const size_t panel = (size_t)f->conditioning * CN_PANEL, in = (size_t)f->colour_in * CN_PANEL;
    float *wanted = calloc(PANELS * panel, sizeof *wanted);
    assert_non_null(wanted);
    backward(&r);
    for (size_t p = 0; p < PANELS; p++)
        memcpy(wanted + p * panel, r.d.in + p * in + (size_t)f->geo_rows * CN_PANEL, sizeof(float) * panel);
    memset(r.d.in, 0x7f, sizeof(float) * PANELS * in);
    type->colour_backward(f, kernel, &r.params, &r.acts, &r.d, PANELS);
    for (size_t p = 0; p < PANELS; p++)
        assert_memory_equal(wanted + p * panel, r.d.in + p * in + (size_t)f->geo_rows * CN_PANEL,
                            sizeof(float) * panel);
    tally t = { type->name, "conditioning", rms(wanted, PANELS * panel), 0, 0, 0 };
    for (size_t i = 0; i < PANELS * panel; i += 7)
        if (i / CN_PANEL % f->conditioning < WANTED) differ(&r, &t, r.conditioning + i, 1e-3f, (double)wanted[i]);
    conclude(&t);
    free(wanted);
    rig_deinit(&r);
}

/* A march computes logits, an export all geometry features, a training step both and what the colour needs. All give
 * the same bits. A sample that is encoded alone gives the same bits as among others. */
static void passes_of(const cn_field_type *type)
{
    rig r;
    rig_init(&r, type);
    const cn_field *f = &r.field;
    float logit[SAMPLES], geo[256 * SAMPLES];
    forward(&r);
    for (int alone = 0; alone < 2; alone++) {
        float *enc = calloc((size_t)PANELS * f->enc_rows * CN_PANEL, sizeof *enc);
        assert_non_null(enc);
        for (size_t p = 0; p < PANELS; p += alone ? 1 : PANELS)
            encode(&r, p, alone ? 1 : PANELS, enc);
        assert_memory_equal(enc, r.acts.enc, sizeof(float) * PANELS * f->enc_rows * CN_PANEL);
        free(enc);
    }
    memcpy(r.d.enc, r.acts.enc, sizeof(float) * PANELS * f->enc_rows * CN_PANEL);
    type->logits(f, kernel, &r.params, &r.d, PANELS, logit);
    type->geometry(f, kernel, &r.params, &r.d, PANELS, geo);
    for (size_t p = 0; p < PANELS; p++) {
        const float *in = r.acts.in + p * f->colour_in * CN_PANEL;
        assert_memory_equal(logit + p * CN_PANEL, in, sizeof(float) * CN_PANEL);
        assert_memory_equal(geo + p * f->geo_rows * CN_PANEL, in, sizeof(float) * f->geo_rows * CN_PANEL);
    }
    rig_deinit(&r);
}

/* The gradients of the type's own loss, such as smoothness. */
static void prior_of(const cn_field_type *type)
{
    rig r;
    if (!type->prior_loss) return;
    rig_init(&r, type);
    r.prior = true;
    r.params.prior = 1;
    for (size_t i = 0; i < SAMPLES; i++)
        r.visible[i] = 0.6f + 0.4f * uniform(7, i);
    r.params.visible = r.visible;
    memset(r.d_out, 0, sizeof r.d_out);
    memset(r.d_logit, 0, sizeof r.d_logit);
    assert_true(loss(&r) > 0);
    weights_in(&r);
    backward(&r);
    for (uint32_t s = 0; s < r.field.n_sections; s++)
        section_of(&r, s);
    rig_deinit(&r);
}

/* A distance grows as the density falls, and is 0 where that is half of the largest. */
static void distance_of(const cn_field_type *type)
{
    rig r;
    if (!type->distance) return;
    rig_init(&r, type);
    float low = -20, high = 14, before = INFINITY;
    for (int i = 0; i < 60; i++) {
        const float middle = 0.5f * (low + high);
        if (type->distance(&r.field, r.weights, middle) > 0)
            low = middle;
        else
            high = middle;
    }
    assert_true(fabsf(type->distance(&r.field, r.weights, low)) < 1e-3f);
    assert_true(type->distance(&r.field, r.weights, low + 0.6f) < type->distance(&r.field, r.weights, low + 0.3f));
    for (float logit = low - 9; logit < low; logit += 1) {
        const float distance = type->distance(&r.field, r.weights, logit);
        assert_true(distance < before && distance > 0);
        before = distance;
    }
    rig_deinit(&r);
}

static void density_of(const cn_field_type *type)
{
    tally t = { type->name, "density", 0.1, 0, 0, 0 };
    for (int i = 0; i < 60; i++) {
        const float x = -15 + 0.49f * (float)i, h = 1e-2f;
        const double here = (double)cn_density(type->density, x), above = (double)cn_density(type->density, x + h),
                     below = (double)cn_density(type->density, x - h);
        const double step[2] = { (double)x - (double)(x - h), (double)(x + h) - (double)x };
        assert_true(here >= 0);
        compare(&t, (here - below) / step[0], (above - here) / step[1],
                (double)cn_density_gradient(type->density, x, (float)here));
    }
    conclude(&t);
    const float ends[] = { -1e30f, -200, 0, 200, 1e30f };
    for (size_t i = 0; i < sizeof ends / sizeof *ends; i++) {
        const float density = cn_density(type->density, ends[i]);
        assert_true(isfinite(density) && density >= 0);
        assert_true(isfinite(cn_density_gradient(type->density, ends[i], density)));
    }
}

static void for_each(void (*check)(const cn_field_type *type))
{
    assert_true(cn_field_n_types > 0);
    for (uint32_t i = 0; i < cn_field_n_types; i++)
        check(cn_field_types[i]);
}
static void test_distance(void **state)
{
    (void)state;
    for_each(distance_of);
}
static void test_weights(void **state)
{
    (void)state;
    for_each(weights_of);
}
static void test_table(void **state)
{
    (void)state;
    for_each(table_of);
}
static void test_position(void **state)
{
    (void)state;
    for_each(position_of);
}
static void test_conditioning(void **state)
{
    (void)state;
    for_each(conditioning_of);
}
static void test_passes_agree(void **state)
{
    (void)state;
    for_each(passes_of);
}
static void test_prior(void **state)
{
    (void)state;
    for_each(prior_of);
}
static void test_density(void **state)
{
    (void)state;
    for_each(density_of);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_weights),      cmocka_unit_test(test_table),        cmocka_unit_test(test_position),
        cmocka_unit_test(test_conditioning), cmocka_unit_test(test_passes_agree), cmocka_unit_test(test_density),
        cmocka_unit_test(test_distance),     cmocka_unit_test(test_prior),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
