/* Tests the device interface. A proxy device sees each operation of a training step. It lets the device do it, then
 * the scalar reference from the same state, and compares the results. Usage: test_seam TYPE, for every device of this
 * type. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../unit/train/synthetic.h"
#include "effect/display.h"
#include "effect/effect.h"
#include "effect/sky_hints.h"
#include "list.h"
#include "train/trainer.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { STEPS = 9, ITEMS = 1000, OPS = 3, RESULTS = 4, LOSSES = 6 };

/* ---- chains ---- */

typedef struct visits {
    uint8_t done[ITEMS];
    int wrong;
} visits;

static void visit(visits *v, size_t item, uint8_t op)
{
    if (item >= ITEMS || __atomic_fetch_add(&v->done[item], 1, __ATOMIC_RELAXED) != op)
        __atomic_fetch_add(&v->wrong, 1, __ATOMIC_RELAXED);
}
static void first(void *user, size_t item, unsigned worker)
{
    (void)worker;
    visit(user, item, 0);
}
static void second(void *user, size_t item, unsigned worker)
{
    (void)worker;
    visit(user, item, 1);
}
static void third(void *user, size_t item, unsigned worker)
{
    (void)worker;
    visit(user, item, 2);
}

/* Every item gets every operation of its chain once, in order, also with several chains of any size. */
static void test_chains(void **unused)
{
    (void)unused;
    static const cn_op ops[OPS] = { { .kind = CN_OP_RAYS, .item = first },
                                    { .kind = CN_OP_MARCH, .item = second },
                                    { .kind = CN_OP_PLACE, .item = third } };
    static const size_t items[] = { 1, 0, ITEMS, 7 };
    static const uint32_t n_ops[] = { 3, 2, 1, 3 };
    for (uint32_t d = 0; d < n_choices; d++) {
        cn_context ctx = { 0 };
        visits v[4] = { 0 };
        cn_chain chains[4];
        assert_int_equal(cn_pool_create(&ctx.pool, 3), CN_OK);
        assert_int_equal(cn_device_create(choice[d], &ctx.device), CN_OK);
        for (int i = 0; i < 4; i++)
            chains[i] = (cn_chain){ ops, n_ops[i], items[i], &v[i] };
        assert_int_equal(cn_device_run(&ctx, chains, 4), CN_OK);
        for (int i = 0; i < 4; i++) {
            assert_int_equal(v[i].wrong, 0);
            for (size_t k = 0; k < ITEMS; k++)
                assert_int_equal(v[i].done[k], k < items[i] ? n_ops[i] : 0);
        }
        cn_device_destroy(&ctx.device);
        cn_pool_destroy(&ctx.pool);
    }
}

static void test_memory(void **unused)
{
    (void)unused;
    for (uint32_t d = 0; d < n_choices; d++) {
        cn_context ctx = { 0 };
        cn_arena arena[3];
        assert_int_equal(cn_device_create(choice[d], &ctx.device), CN_OK);
        for (size_t i = 0; i < 3; i++) {
            const size_t size = (size_t)100 << 8 * i;
            assert_int_equal(cn_device_arena_init(&ctx, &arena[i], size), CN_OK);
            unsigned char *bytes = CN_ARENA_NEW(&arena[i], unsigned char, size - CN_ARENA_ALIGN);
            assert_int_equal((uintptr_t)bytes % CN_ARENA_ALIGN, 0);
            for (size_t k = 0; k < size - CN_ARENA_ALIGN; k++) {
                if (bytes[k]) fail_msg("memory of %s does not begin as zeros", choice[d]);
                bytes[k] = 1;
            }
        }
        for (size_t i = 0; i < 3; i++)
            cn_device_arena_deinit(&ctx, &arena[(i + 1) % 3]);
        cn_device_destroy(&ctx.device);
    }
}

/* ---- a training step, operation by operation ---- */

typedef struct between {
    cn_device base;
    cn_device *device; /* that is tested */
    cn_trainer *trainer;
    unsigned char *before, *after;
    double worst[CN_OP_KINDS];
    bool seen[CN_OP_KINDS];
} between;

/* What an operation has to give: floats, or words that have to be equal. */
typedef struct result {
    const float *floats;
    const void *words;
    size_t n;
} result;

static void results_of(const cn_trainer *t, cn_op_kind kind, result r[RESULTS])
{
    const cn_batch *b = &t->batch;
    const size_t panels = b->counts->n_panels;
    memset(r, 0, RESULTS * sizeof *r);
    switch (kind) {
    case CN_OP_RAYS: /* more of it in test_rays.c */
        r[0] = (result){ NULL, b->target, 4 * (size_t)b->n_rays };
        r[1] = (result){ NULL, b->ray_photo, b->n_rays };
        r[2] = (result){ (const float *)(const void *)b->rays, NULL, 9 * (size_t)b->n_rays };
        r[3] = (result){ b->first_t, NULL, b->n_rays };
        break;
    case CN_OP_MARCH:
        r[0] = (result){ b->march_t, NULL, b->n_groups * (size_t)CN_GROUP_CAP };
        r[1] = (result){ NULL, b->ray_samples, b->n_rays };
        r[2] = (result){ b->target, NULL, 4 * (size_t)b->n_rays };
        r[3] = (result){ NULL, b->rays, 9 * (size_t)b->n_rays };
        break;
    case CN_OP_LAY_OUT:
        r[0] = (result){ NULL, b->counts, sizeof *b->counts / sizeof(uint32_t) };
        r[1] = (result){ NULL, b->group_panel, 2 * (size_t)b->n_groups };
        break;
    case CN_OP_PLACE: r[0] = (result){ b->pos, NULL, panels * 3 * CN_PANEL }; break;
    case CN_OP_ENCODE: r[0] = (result){ b->enc, NULL, panels * b->enc_rows * CN_PANEL }; break;
    case CN_OP_SHADE:
        r[0] = (result){ t->slot_grad, NULL, CN_SLOTS * t->parameters.n };
        r[1] = (result){ b->enc, NULL, panels * b->enc_rows * CN_PANEL };
        r[2] = (result){ b->visit_seen, NULL, panels * CN_PANEL };
        if (t->support.visit) r[3] = (result){ NULL, t->support.visit, panels * CN_PANEL };
        break;
    case CN_OP_OPTIMISE:
        r[0] = (result){ t->parameters.value, NULL, t->parameters.n };
        r[1] = (result){ t->parameters.derived, NULL, t->parameters.field.n_derived };
        r[2] = (result){ t->effects.derived, NULL, t->effects.pack.n_shared };
        break;
    case CN_OP_OCCUPANCY:
        r[0] = (result){ t->occ.seen, NULL, CN_OCC_CELLS };
        for (int i = 0; i < 3 && t->support.photo; i++)
            r[1 + i] = (result){ NULL, (const float *[]){ t->support.photo, t->support.since, t->support.times }[i],
                                 CN_SUPPORT_CELLS };
        break;
    default: break;
    }
}

/* Norm of the difference, divided by the norm of the reference. */
static double compare_floats(const float *got, const float *wanted, size_t n)
{
    double difference = 0, norm = 1e-20;
    for (size_t i = 0; i < n; i++) {
        difference += pow((double)got[i] - (double)wanted[i], 2);
        norm += pow((double)wanted[i], 2);
    }
    return sqrt(difference / norm);
}

static double compare_table(const uint16_t *got, const uint16_t *wanted, size_t n)
{
    double difference = 0, norm = 1e-20;
    for (size_t i = 0; i < n; i++) {
        const double w = (double)cn_bf16_to_float(wanted[i]);
        difference += pow((double)cn_bf16_to_float(got[i]) - w, 2);
        norm += w * w;
    }
    return sqrt(difference / norm);
}

/* Where the float parameters of the field and of each effect begin, in order; returns the number of parts. Parts differ
 * in size by so much that one would hide another's error. */
static size_t parts_of(const cn_trainer *t, size_t first[2 * CN_MAX_EFFECTS + 2])
{
    const cn_effect_pack *pack = &t->effects.pack;
    size_t n = 0;
    first[n++] = 0;
    for (uint32_t i = 0; i < pack->n_on; i++)
        if (pack->on[i].effect->photo_params) first[n++] = t->parameters.photo_at + pack->on[i].photo;
    for (uint32_t i = 0; i < pack->n_on; i++)
        if (pack->on[i].effect->shared_params) first[n++] = t->parameters.shared_at + pack->on[i].shared;
    first[n] = t->parameters.n;
    return n;
}

/* The worst part's error, of so many rows of values of all parameters. */
static double compare_parts(const cn_trainer *t, const float *got, const float *wanted, size_t rows)
{
    size_t first[2 * CN_MAX_EFFECTS + 2];
    const size_t n = parts_of(t, first);
    double worst = 0;
    for (size_t k = 0; k < n; k++) {
        double difference = 0, norm = 1e-30;
        for (size_t row = 0; row < rows; row++)
            for (size_t i = row * t->parameters.n + first[k]; i < row * t->parameters.n + first[k + 1]; i++) {
                difference += pow((double)got[i] - (double)wanted[i], 2);
                norm += pow((double)wanted[i], 2);
            }
        worst = fmax(worst, sqrt(difference / norm));
    }
    return worst;
}

/* The sums of the photos' colours that the device has given, where it does all of the effects. */
static double compare_colours(const between *s, const float *sums)
{
    const cn_trainer *t = s->trainer;
    const cn_batch *b = &t->batch;
    double got[7] = { 0 }, wanted[7] = { 0 }, worst = 0;
    if (t->device.step.settings.effects_by_processor) return 0;
    for (size_t slot = 0; slot < CN_SLOTS; slot++)
        for (int i = 0; i < 7; i++)
            got[i] += (double)sums[slot * CN_STEP_SUM_KINDS + CN_SUM_COLOUR + i];
    for (uint32_t r = 0; r < b->n_rays; r++) {
        const uint32_t g = r / CN_GROUP;
        const bool has = cn_batch_has(b, g) && (b->group_samples[g] || t->effects.pack.background.n);
        float shown[3];
        if (!has || !(b->target[4 * (size_t)r + 3] > 0)) continue;
        cn_display(b->target + 4 * (size_t)r, shown);
        for (int c = 0; c < 3; c++) {
            wanted[c] += (double)shown[c];
            wanted[3 + c] += (double)shown[c] * (double)shown[c];
        }
        wanted[6]++;
    }
    assert_true(wanted[6] > 0);
    for (int i = 0; i < 7; i++)
        worst = fmax(worst, fabs(got[i] - wanted[i]) / fmax(wanted[i], 1e-20));
    return worst;
}

/* The sums of the losses that the device has given, against those of the reference. */
static double compare_losses(const between *s)
{
    const cn_trainer *t = s->trainer;
    const float *sums = (const float *)(const void *)(s->after + ((unsigned char *)t->device.sums - t->arena.base));
    double got[LOSSES] = { 0 }, wanted[LOSSES] = { 0 }, worst = 0;
    static const cn_step_sum which[LOSSES] = { CN_SUM_ERROR, CN_SUM_WEIGHED_ERROR, CN_SUM_WEIGHT,
                                               CN_SUM_RAYS,  CN_SUM_BAD,           CN_SUM_GRADIENT };
    if (!(sums[CN_SUM_BY_DEVICE] > 0)) return 0;
    for (size_t slot = 0; slot < CN_SLOTS; slot++) {
        const cn_step_stats *of = &t->slot_stats[slot];
        const double row[LOSSES] = { of->squared_error, of->weighed_error, of->weight,
                                     (double)of->rays,  (double)of->bad,   of->gradient };
        for (int i = 0; i < LOSSES; i++) {
            got[i] += (double)sums[slot * CN_STEP_SUM_KINDS + which[i]];
            wanted[i] += row[i];
        }
    }
    for (int i = 0; i < LOSSES; i++)
        worst = fmax(worst, fabs(got[i] - wanted[i]) / fmax(wanted[i], 1e-20));
    return fmax(worst, compare_colours(s, sums));
}

static void compare(between *s, cn_op_kind kind)
{
    const cn_trainer *t = s->trainer;
    double error = 0;
    result r[RESULTS];
    results_of(t, kind, r);
    for (int i = 0; i < RESULTS; i++) {
        const unsigned char *wanted = r[i].floats ? (const unsigned char *)r[i].floats : r[i].words;
        if (!wanted) continue;
        const void *got = s->after + (wanted - t->arena.base);
        if (r[i].floats == t->slot_grad || r[i].floats == t->parameters.value)
            error = fmax(error, compare_parts(t, got, r[i].floats, r[i].n / t->parameters.n));
        else if (r[i].floats)
            error = fmax(error, compare_floats(got, r[i].floats, r[i].n));
        else
            assert_memory_equal(got, wanted, r[i].n * sizeof(uint32_t));
    }
    if (kind == CN_OP_SHADE) error = fmax(error, compare_losses(s));
    if (kind == CN_OP_OPTIMISE_TABLE) {
        const size_t at = (size_t)((const unsigned char *)t->parameters.table - t->arena.base);
        error =
            compare_table((const uint16_t *)(const void *)(s->after + at), t->parameters.table, t->parameters.table_n);
    }
    s->seen[kind] = true;
    s->worst[kind] = fmax(s->worst[kind], error);
}

/* After a few steps all is fog, which no ray counts as seen. And few cells, so that rays of many photos meet in one.
 */
static void see_more(cn_trainer *t)
{
    const size_t lanes = (size_t)t->batch.counts->n_panels * CN_PANEL;
    for (size_t i = 0; t->support.photo && i < lanes; i++)
        t->batch.visit_seen[i] = fminf(1, 20 * t->batch.visit_seen[i]), t->support.visit[i] %= 997;
}

static cn_status run_both(cn_device *base, const cn_context *ctx, const cn_chain *chains, uint32_t n);

/* A chain of operations, one after the other. */
static cn_status run_each(cn_device *base, const cn_context *ctx, const cn_chain *chain)
{
    for (uint32_t i = 0; i < chain->n_ops; i++) {
        const cn_chain one = { &chain->op[i], 1, chain->items, chain->user };
        CN_TRY(run_both(base, ctx, &one, 1));
    }
    return CN_OK;
}

static cn_status run_both(cn_device *base, const cn_context *ctx, const cn_chain *chains, uint32_t n)
{
    if (n == 1 && chains->n_ops > 1) return run_each(base, ctx, chains);
    between *s = (between *)base;
    cn_trainer *t = s->trainer;
    const cn_context inner = { .pool = ctx->pool, .device = s->device };
    const cn_kernel *kernel = t->kernel;
    const cn_step_stats stats = t->stats;
    if (chains[0].op[0].kind == CN_OP_OPTIMISE) see_more(t); /* with the occupancy, in a chain beside it */
    memcpy(s->before, t->arena.base, t->arena.size);
    CN_TRY(cn_device_forget(&inner, &t->device.step));
    CN_TRY(cn_device_run(&inner, chains, n));
    CN_TRY(cn_device_fetch(&inner, &t->device.step));
    memcpy(s->after, t->arena.base, t->arena.size);
    memcpy(t->arena.base, s->before, t->arena.size);
    t->kernel = &cn_kernel_ref;
    cn_processor_run(ctx, chains, n);
    t->kernel = kernel;
    t->stats = stats;
    for (uint32_t i = 0; i < n; i++)
        compare(s, chains[i].op[0].kind);
    memcpy(t->arena.base, s->after, t->arena.size);
    return CN_OK;
}

static cn_status memory_of(cn_device *base, size_t size, cn_arena *arena)
{
    const cn_context inner = { .device = ((between *)base)->device };
    return cn_device_arena_init(&inner, arena, size);
}

static void free_memory_of(cn_device *base, cn_arena *arena)
{
    const cn_context inner = { .device = ((between *)base)->device };
    cn_device_arena_deinit(&inner, arena);
}

static const cn_device_type between_type = {
    .name = "between", .memory = memory_of, .free_memory = free_memory_of, .run = run_both
};

/* All effects but this one; NULL: all. form: an earlier form of an effect, to take instead. */
static void turn_all_on(synthetic_scene *synthetic, const char *but, const char *form)
{
    synthetic->tile.n_effects = 0;
    for (uint32_t i = 0; i < cn_effect_count; i++) {
        if (but && strcmp(cn_effect_list[i]->name, but) == 0) continue;
        cn_plan_effect *e = &synthetic->tile.effects[synthetic->tile.n_effects++];
        memset(e, 0, sizeof *e);
        const bool earlier = form && strcmp(cn_effect_find(form)->name, cn_effect_list[i]->name) == 0;
        snprintf(e->name, sizeof e->name, "%s", earlier ? form : cn_effect_list[i]->name);
        e->on = true;
    }
}

/* So that every rule of the effects applies: photos of two capture runs, with gains that are to be learned; photos that
 * show sky, and none; cells that were seen often; rows that are not zero; and samples that are brighter than the pixel
 * that they are a part of. */
static void prepare(cn_trainer *t)
{
    for (uint32_t e = 0; e < t->effects.pack.n_on; e++) {
        const cn_effect_step *step = &t->effects.pack.on[e];
        const uint32_t width = step->effect->photo_constants;
        float *last = t->effects.constants + step->constants + width - 1;
        for (uint32_t i = 0; width && i < t->effects.n_photos; i++)
            last[width * (size_t)i] = step->effect->ray ? (float)(i % 3) : 1;
    }
    for (uint32_t i = 0; t->effects.run && i < t->effects.n_photos; i++)
        t->effects.run[i] = (float)(i % 3); /* 0: unknown */
    for (uint32_t i = 0; t->effects.trend && i < 3 * t->effects.n_photos; i++)
        t->effects.trend[i / 3][i % 3] = 0.3f * sinf((float)i);
    for (size_t i = 0; t->support.photo && i < CN_SUPPORT_CELLS; i += 3)
        t->support.times[i] = 100;
    for (size_t i = 0; t->sampler.sky_hint && i < (size_t)t->effects.n_photos * CN_SKY_HINTS; i++)
        t->sampler.sky_hint[i] = (uint8_t)(i / 11 % (CN_SKY_NONE_LATE + 1));
    enum { LAST_LAYER = 256, BRIGHTER = 8 };
    for (size_t i = t->parameters.field.n_weights - LAST_LAYER; i < t->parameters.field.n_weights; i++)
        t->parameters.value[i] *= BRIGHTER;
    for (size_t i = t->parameters.photo_at; i < t->parameters.shared_at; i++)
        t->parameters.value[i] = 0.01f * (float)((int)(i * 7 % 11) - 5);
}

/* A few steps with every effect on. */
static void train(synthetic_scene *synthetic, between *s)
{
    const cn_context ctx = { .device = &s->base };
    const cn_train_input input = { &synthetic->scene, &synthetic->index, synthetic->pixels, &synthetic->tile };
    cn_train_options o = synthetic_options();
    cn_trainer *t = s->trainer = calloc(1, sizeof *t);
    cn_arena counter;
    o.precision = CN_PRECISION_FLOAT;
    t->ctx = &ctx;
    assert_int_equal(cn_trainer_plan(t, &input, &o, 1), CN_OK);
    t->support.n_photos = 0; /* a cell that was seen often counts as single-view from the next step on */
    cn_arena_count(&counter);
    cn_trainer_carve(t, &counter);
    assert_int_equal(cn_device_arena_init(&ctx, &t->arena, counter.used), CN_OK);
    cn_trainer_carve(t, &t->arena);
    assert_int_equal(cn_trainer_begin(t), CN_OK);
    prepare(t);
    s->before = malloc(t->arena.size);
    s->after = malloc(t->arena.size);
    while (t->step < STEPS)
        assert_int_equal(cn_trainer_step(t), CN_OK);
    free(s->before);
    free(s->after);
    cn_trainer_deinit(t);
    free(t);
}

static void check_step(bool effects, const char *but, const char *form)
{
    synthetic_scene synthetic;
    synthetic_scene_init(&synthetic, 9);
    if (effects) turn_all_on(&synthetic, but, form);
    for (uint32_t d = 0; d < n_choices; d++) {
        between s = { .base = { .type = &between_type } };
        assert_int_equal(cn_device_create(choice[d], &s.device), CN_OK);
        train(&synthetic, &s);
        for (int kind = 0; kind < CN_OP_TRACE; kind++) {
            if (!s.seen[kind]) continue;
            printf("%s: %-15s worst error %.1e\n", cn_device_about(s.device)->name, cn_op_name[kind], s.worst[kind]);
            assert_true(s.worst[kind] < 1e-4);
        }
        /* A refill comes late in a long schedule (test_training.c). */
        for (int kind = 0; kind < CN_OP_TRACE; kind++)
            assert_true(s.seen[kind] || kind == CN_OP_REFILL);
        cn_device_destroy(&s.device);
    }
    synthetic_scene_deinit(&synthetic);
}

static void test_step(void **unused)
{
    (void)unused;
    check_step(false, NULL, NULL);
}

static void test_step_with_all_effects(void **unused)
{
    (void)unused;
    check_step(true, NULL, NULL);
}

/* Without moving cameras a device does all of the effects; the processor does a part of pose refinement. */
static void test_step_with_all_but_moving_cameras(void **unused)
{
    (void)unused;
    check_step(true, "pose_refinement", NULL);
}

/* No shader knows an earlier form of the sky: the processor does what belongs to effects. */
static void test_step_with_effects_of_the_processor(void **unused)
{
    (void)unused;
    check_step(true, NULL, "sky by input");
}

int main(int argc, char **argv)
{
    if (!list_devices(argc, argv)) return 77;
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_chains),
                                        cmocka_unit_test(test_memory),
                                        cmocka_unit_test(test_step),
                                        cmocka_unit_test(test_step_with_all_effects),
                                        cmocka_unit_test(test_step_with_all_but_moving_cameras),
                                        cmocka_unit_test(test_step_with_effects_of_the_processor) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
