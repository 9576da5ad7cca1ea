/* Whole passes over the field on all processors: a training step in which every sample is live (encode, MLPs, their
 * backward passes, Adam), and a render of the same samples. Beside both is what the limits of the machine allow, which
 * are measured in the same run.
 * usage: bench_work [--quick] [FILE.csv] Columns: figure, M samples/s by the clock, by processor time (the same on a
 * machine that does nothing else), at the limits, and the share of these that processor time shows.
 * tests/bench/peer_torch.py does the same training step. */
#include "../unit/field/options.h"
#include "base/clock.h"
#include "base/rng.h"
#include "field/field.h"
#include "limits.h"

#include <stdio.h>
#include <stdlib.h>

enum { LOG2_TABLE = 19 };

enum { PANELS = 683, SAMPLES = PANELS * CN_PANEL, RAY_SAMPLES = 32, BLOCKS = 8, SLOTS = 32, STEPS = 15 };

typedef struct work {
    const cn_kernel *kernel;
    cn_pool *pool;
    unsigned threads, parts;
    cn_field field;
    cn_field_params params;
    cn_arena arena;
    float *weights, *transposed, *moment[2], *grad, *slot_grad, *pos, *length, *t, *enc, *d_logit, **part_grad;
    uint8_t **touched;
    uint16_t *table, *state;
    cn_field_acts *acts, *d;
    bool backward;
} work;

static void encode_block(void *user, size_t item, unsigned thread)
{
    (void)thread;
    const work *w = user;
    const size_t block = item % BLOCKS, first = PANELS * block / BLOCKS, last = PANELS * (block + 1) / BLOCKS;
    w->field.type->encode(&w->field, w->kernel, (uint32_t)(item / BLOCKS),
                          &(cn_field_encoding){ w->params.table, w->pos + first * 3 * CN_PANEL, last - first,
                                                w->enc + first * w->field.enc_rows * CN_PANEL });
}

/* Runs a few panels through the MLPs. The loss is the mean square of their output, less a constant. */
static void run_slot(void *user, size_t slot, unsigned thread)
{
    const work *w = user;
    const size_t first = PANELS * slot / SLOTS, n = PANELS * (slot + 1) / SLOTS - first,
                 rows = (size_t)w->field.enc_rows * CN_PANEL;
    cn_field_acts acts = w->acts[thread], d = w->d[thread];
    float *grad = w->slot_grad + slot * w->field.n_weights;
    acts.enc = w->enc + first * rows;
    w->field.type->density_pass(&w->field, w->kernel, &w->params, &acts, n);
    w->field.type->colour_pass(&w->field, w->kernel, &w->params, &acts, n);
    if (!w->backward) return;
    for (size_t i = 0; i < n * 4 * CN_PANEL; i++)
        d.out[i] = (acts.out[i] - 0.5f) * (2.0f / (4 * SAMPLES));
    memset(grad, 0, w->field.n_weights * sizeof *grad);
    w->field.type->backward(&w->field, w->kernel, &w->params, &acts, &(cn_field_gradient){ &d, w->d_logit, grad }, n);
    memcpy(acts.enc, d.enc, n * rows * sizeof(float));
}

static const cn_adam adam = { .rate = 1e-3f, .beta1 = 0.9f, .beta2 = 0.99f, .epsilon = 1e-15f, .dither = 0x8000 };

static void update_weights(const work *w)
{
    const size_t n = w->field.n_weights;
    for (size_t s = 0; s < SLOTS; s++)
        for (size_t i = 0; i < n; i++)
            w->grad[i] += w->slot_grad[s * n + i];
    w->kernel->adam(&adam, w->weights, w->moment[0], w->moment[1], w->grad, n);
    w->field.type->prepare(&w->field, w->weights, w->transposed);
}

static cn_range part_of(const work *w, const cn_level *level, uint32_t part)
{
    const uint32_t size = ((level->entries + 7) / 8 + w->parts - 1) / w->parts * 8, first = size * part;
    if (first >= level->entries) return (cn_range){ 0, 0 };
    return (cn_range){ first, level->entries - first < size ? level->entries - first : size };
}

static void update_item(void *user, size_t item, unsigned thread)
{
    const work *w = user;
    if (!item) {
        update_weights(w);
        return;
    }
    const uint32_t l = w->field.grid.n_levels - 1 - (uint32_t)(item - 1) / w->parts;
    const cn_level *level = &w->field.grid.level[l];
    const cn_range range = part_of(w, level, (uint32_t)(item - 1) % w->parts);
    const size_t at = 2 * ((size_t)level->offset + range.first);
    if (!range.count) return;
    w->kernel->encode_backward(level, &(cn_encode_gradient){ w->pos, w->enc + (size_t)l * 2 * CN_PANEL,
                                                             (size_t)w->field.enc_rows * CN_PANEL, PANELS, &range,
                                                             w->part_grad[thread], w->touched[thread] });
    w->kernel->adam_table(&adam, w->table + at, cn_state_at(w->state, at / 16 * 16) + (size_t)l * CN_STATE_BLOCK,
                          w->part_grad[thread], w->touched[thread], 2 * (size_t)range.count);
}

static void forward(work *w)
{
    cn_pool_run(w->pool, (size_t)w->field.grid.n_levels * BLOCKS, encode_block, w);
    cn_pool_run(w->pool, SLOTS, run_slot, w);
}

static void train(work *w)
{
    forward(w);
    cn_pool_run(w->pool, 1 + (size_t)w->field.grid.n_levels * w->parts, update_item, w);
}

/* ---- buffers ---- */

static void carve(work *w, cn_arena *a)
{
    const size_t n = w->field.n_weights, entries = w->field.entries, most = PANELS / SLOTS + 1;
    float **flat[] = { &w->weights, &w->transposed, &w->moment[0], &w->moment[1], &w->grad };
    for (size_t i = 0; i < sizeof flat / sizeof *flat; i++)
        *flat[i] = CN_ARENA_NEW(a, float, n);
    w->slot_grad = CN_ARENA_NEW(a, float, SLOTS *n);
    w->pos = CN_ARENA_NEW(a, float, 3 * SAMPLES);
    w->length = CN_ARENA_NEW(a, float, SAMPLES);
    w->t = CN_ARENA_NEW(a, float, RAY_SAMPLES);
    w->enc = CN_ARENA_NEW(a, float, (size_t)SAMPLES * w->field.enc_rows);
    w->d_logit = CN_ARENA_NEW(a, float, most *CN_PANEL);
    w->table = CN_ARENA_NEW(a, uint16_t, 2 * entries);
    w->state = CN_ARENA_NEW(a, uint16_t, (2 * entries / 16 + CN_MAX_LEVELS + 1) * CN_STATE_BLOCK);
    w->acts = CN_ARENA_NEW(a, cn_field_acts, w->threads);
    w->d = CN_ARENA_NEW(a, cn_field_acts, w->threads);
    w->part_grad = CN_ARENA_NEW(a, float *, w->threads);
    w->touched = CN_ARENA_NEW(a, uint8_t *, w->threads);
    for (unsigned i = 0; i < w->threads; i++) {
        cn_field_acts acts, d;
        w->field.type->acts_take(&w->field, a, most, &acts);
        w->field.type->acts_take(&w->field, a, most, &d);
        float *grad = CN_ARENA_NEW(a, float, (size_t)2 << LOG2_TABLE);
        uint8_t *touched = CN_ARENA_NEW(a, uint8_t, (size_t)1 << LOG2_TABLE);
        if (a->counting) continue;
        w->acts[i] = acts;
        w->d[i] = d;
        w->part_grad[i] = grad;
        w->touched[i] = touched;
    }
}

/* Rays of 32 samples, which are a 256th of the distance apart, as in training. */
static void place(work *w)
{
    w->t[0] = 1;
    for (size_t i = 1; i < RAY_SAMPLES; i++)
        w->t[i] = w->t[i - 1] * (1 + 1.0f / 256);
    for (size_t i = 0; i < SAMPLES / RAY_SAMPLES; i++) {
        cn_box_ray ray;
        for (size_t a = 0; a < 3; a++) {
            ray.origin[a] = cn_rng_float(7, 1, 3 * i + a) - 0.5f;
            ray.dir[a] = cn_rng_float(7, 2, 3 * i + a) - 0.5f;
        }
        w->kernel->place(&ray, w->t, RAY_SAMPLES, (cn_spacing){ 1.0f / 256, 1 }, (cn_lanes){ w->pos, i * RAY_SAMPLES },
                         w->length);
    }
}

static cn_status make(work *w)
{
    const cn_field_options config = hash_options((hash_sizes){ .levels = 16,
                                                               .log2_table = LOG2_TABLE,
                                                               .base_resolution = 16,
                                                               .finest_resolution = 4096,
                                                               .density_width = 64,
                                                               .colour_width = 64 });
    w->kernel = cn_kernel_best();
    CN_TRY(cn_pool_create(&w->pool, 0));
    w->threads = cn_pool_threads(w->pool);
    CN_TRY(cn_field_layout(&w->field, &config, (cn_field_inputs){ 0 }));
    for (w->parts = 1; w->parts * w->field.n_sections < 2 * w->threads;)
        w->parts *= 2;
    cn_arena counter;
    cn_arena_count(&counter);
    carve(w, &counter);
    CN_TRY(cn_arena_init(&w->arena, counter.used));
    carve(w, &w->arena);
    float *table = calloc(2 * w->field.entries, sizeof *table);
    if (!table) return cn_fail(CN_ERR_NOMEM, "out of memory");
    w->field.type->init(&w->field, 1, table, w->weights);
    for (size_t i = 0; i < 2 * w->field.entries; i++)
        w->table[i] = cn_bf16_from_float(table[i]);
    free(table);
    w->field.type->prepare(&w->field, w->weights, w->transposed);
    w->params = (cn_field_params){ (const uint32_t *)(const void *)w->table, w->weights, w->transposed, 0, NULL };
    place(w);
    return CN_OK;
}

/* ---- figures ---- */

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Median seconds of a step: by the clock, and by the processor time of all threads divided by their number. */
typedef struct duration {
    double clock, processor;
} duration;

static duration median_step(work *w, void (*step)(work *w), int n)
{
    double clock[STEPS], processor[STEPS];
    step(w);
    for (int i = 0; i < n; i++) {
        const double start = cn_clock_s(CLOCK_MONOTONIC), ran = cn_clock_s(CLOCK_PROCESS_CPUTIME_ID);
        step(w);
        clock[i] = cn_clock_s(CLOCK_MONOTONIC) - start;
        processor[i] = (cn_clock_s(CLOCK_PROCESS_CPUTIME_ID) - ran) / w->threads;
    }
    qsort(clock, (size_t)n, sizeof *clock, by_value);
    qsort(processor, (size_t)n, sizeof *processor, by_value);
    return (duration){ clock[n / 2], processor[n / 2] };
}

/* Nanoseconds a sample on one processor, at the limits. */
typedef struct bound {
    double forward, backward, encode, encode_backward, adam;
} bound;

static bound limits_of(const work *w)
{
    bound b = { 0 };
    double macs = 0;
    for (int l = 0; l < CN_LAYERS; l++)
        macs += (double)w->field.mlp.layer[l].out * w->field.mlp.layer[l].in;
    b.forward = 2 * macs / bench_fma_peak(w->kernel->name);
    b.backward = 2 * b.forward;
    for (uint32_t l = 0; l < w->field.grid.n_levels; l++) {
        b.encode +=
            bench_lines(w->field.grid.level[l].hashed) * bench_random_read((size_t)w->field.grid.level[l].entries * 4);
        b.encode_backward += bench_gradient_lines(w->field.grid.level[l].hashed) *
                             bench_random_update((size_t)w->field.grid.level[l].entries * 8);
    }
    /* A batch of this size, spread over the box, uses nearly every line of the table and its state: 8 bytes for each
     * parameter, read and written. */
    b.adam = 2.0 * (double)w->field.entries * 16 / bench_stream() / SAMPLES;
    return b;
}

static void figure(FILE *csv, const char *name, duration took, double limit_ns, const work *w)
{
    const double rate = SAMPLES / took.clock * 1e-6, alone = SAMPLES / took.processor * 1e-6,
                 limit = 1e3 * w->threads / limit_ns;
    printf("| %s | %.2f | %.2f | %.2f | %.0f %% |\n", name, rate, alone, limit, 100 * alone / limit);
    if (csv) fprintf(csv, "%s,%.4f,%.4f,%.4f,%.4f\n", name, rate, alone, limit, alone / limit);
}

int main(int argc, char **argv)
{
    static work w;
    const bool quick = argc > 1 && strcmp(argv[1], "--quick") == 0;
    const char *file = argc > 1 + quick ? argv[1 + quick] : NULL;
    FILE *csv = file ? fopen(file, "w") : NULL;
    if (make(&w) != CN_OK || (file && !csv)) {
        fprintf(stderr, "bench_work: %s\n", file && !csv ? "the file cannot be written" : cn_error_message());
        return 1;
    }
    if (quick) bench_repeats = 3;
    const bound b = limits_of(&w);
    const int steps = quick ? 5 : STEPS;
    printf("Whole passes, %u samples a step, %u threads, %s. Limits a sample and thread: MLPs %.0f + %.0f ns "
           "(multiply-adds), encode %.0f + "
           "%.0f ns (random reads, updates), Adam %.0f ns (memory stream).\n\n",
           SAMPLES, w.threads, w.kernel->name, b.forward, b.backward, b.encode, b.encode_backward, b.adam);
    printf("| pass | M samples/s | by processor time | at the limits | reached |\n|---|---|---|---|---|\n");
    if (csv) fprintf(csv, "figure,m_samples_per_s,by_processor_time,at_limit,share\n");
    w.backward = true;
    figure(csv, "training in full", median_step(&w, train, steps),
           b.forward + b.backward + b.encode + b.encode_backward + b.adam, &w);
    w.backward = false;
    figure(csv, "rendering in full", median_step(&w, forward, steps), b.forward + b.encode, &w);
    cn_arena_deinit(&w.arena);
    cn_pool_destroy(&w.pool);
    return csv && fclose(csv) ? 1 : 0;
}
