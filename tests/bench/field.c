/* Speed of the field's kernels on every instruction set of this processor. Beside each is the limit of the machine that
 * applies, measured in the same run. One thread, processor time, medians. usage: bench_field [--quick] [FILE.csv]
 * Columns: kernel, set, ns a sample, GFLOP/s, GB/s, limit, ns a sample at the limit, share of the limit that is
 * reached. */
#include "../unit/field/options.h"
#include "base/rng.h"
#include "field/field.h"
#include "limits.h"

#include <stdio.h>
#include <stdlib.h>

enum { LOG2_TABLE = 19 };

enum { PANELS = 512, SAMPLES = PANELS * CN_PANEL, MLP_PANELS = 16, RAY_SAMPLES = 32, RAYS = SAMPLES / RAY_SAMPLES };

typedef struct rig {
    const cn_kernel *kernel;
    cn_field field;
    cn_arena arena;
    float *weights, *transposed, *dw, *pos, *length, *t, *enc, *d_logit, *grad, *pattern, *flat[4];
    uint16_t *table, *state;
    uint8_t *touched;
    uint32_t *occ;
    cn_field_acts acts, d;
    cn_box_ray rays[RAYS];
    uint32_t level, marched;
} rig;

typedef struct limits {
    double stream, read[CN_MAX_LEVELS], update[CN_MAX_LEVELS], fma;
} limits;

static FILE *csv;

static void row(const char *kernel, const rig *r, double ns, double flops, double bytes, const char *limit,
                double limit_ns)
{
    printf("| %-23s | %-10s | %9.2f | %7.1f | %6.1f | %-14s | %8.2f | %5.0f %% |\n", kernel, r->kernel->name, ns,
           flops / ns, bytes / ns, limit, limit_ns, 100 * limit_ns / ns);
    if (csv)
        fprintf(csv, "%s,%s,%.4f,%.3f,%.3f,%s,%.4f,%.4f\n", kernel, r->kernel->name, ns, flops / ns, bytes / ns, limit,
                limit_ns, limit_ns / ns);
}

/* ---- what is timed ---- */

static void run_gemm(void *user)
{
    const rig *r = user;
    const cn_layer *l = &r->field.mlp.layer[r->level];
    for (size_t p = 0; p < MLP_PANELS; p++)
        r->kernel->gemm((cn_matrix){ r->transposed + l->offset, l->out, l->in },
                        r->acts.own[CN_MLP_COLOUR0] + p * l->in * CN_PANEL,
                        r->acts.own[CN_MLP_COLOUR1] + p * l->out * CN_PANEL, NULL, true);
}

static void run_weight_grad(void *user)
{
    const rig *r = user;
    const cn_layer *l = &r->field.mlp.layer[CN_LAYER_COLOUR1];
    for (size_t p = 0; p < MLP_PANELS; p += 4)
        r->kernel->weight_grad(
            &(cn_panel_rows){ r->d.own[CN_MLP_COLOUR1] + p * l->out * CN_PANEL, (size_t)l->out * CN_PANEL, l->out },
            &(cn_panel_rows){ r->acts.own[CN_MLP_COLOUR0] + p * l->in * CN_PANEL, (size_t)l->in * CN_PANEL, l->in }, 4,
            r->dw);
}

static void run_mlp(void *user)
{
    const rig *r = user;
    const cn_field_params params = { NULL, r->weights, r->transposed, 0, NULL };
    r->field.type->density_pass(&r->field, r->kernel, &params, &r->acts, MLP_PANELS);
    r->field.type->colour_pass(&r->field, r->kernel, &params, &r->acts, MLP_PANELS);
    r->field.type->backward(&r->field, r->kernel, &params, &r->acts, &(cn_field_gradient){ &r->d, r->d_logit, r->dw },
                            MLP_PANELS);
}

static void run_encode(void *user)
{
    const rig *r = user;
    r->field.type->encode(&r->field, r->kernel, r->level,
                          &(cn_field_encoding){ (const uint32_t *)(const void *)r->table, r->pos, PANELS, r->enc });
}

static void run_encode_backward(void *user)
{
    const rig *r = user;
    const cn_level *level = &r->field.grid.level[r->level];
    const cn_range all = { 0, level->entries };
    r->kernel->encode_backward(level, &(cn_encode_gradient){ r->pos, r->enc + (size_t)r->level * 2 * CN_PANEL,
                                                             (size_t)r->field.enc_rows * CN_PANEL, PANELS, &all,
                                                             r->grad, r->touched });
}

static const cn_adam adam = { .rate = 1e-3f, .beta1 = 0.9f, .beta2 = 0.99f, .epsilon = 1e-15f, .dither = 0x8000 };

/* All hashed levels, one after the other through one buffer of gradients, as in a training step. The time to fill that
 * buffer counts too. */
static void run_adam_table(void *user)
{
    const rig *r = user;
    for (uint32_t l = 0; l < r->field.grid.n_levels; l++) {
        const cn_level *level = &r->field.grid.level[l];
        if (!level->hashed) continue;
        const size_t n = 2 * (size_t)level->entries, first = 2 * (size_t)level->offset;
        memcpy(r->grad, r->pattern, n * sizeof *r->grad);
        for (size_t i = 0; i < n; i += 16)
            r->touched[i / 16] = r->pattern[i] != 0;
        r->kernel->adam_table(&adam, r->table + first, cn_state_at(r->state, first / 16 * 16), r->grad, r->touched, n);
    }
}

enum { FLAT = 1 << 24 };
static void run_adam(void *user)
{
    const rig *r = user;
    r->kernel->adam(&adam, r->flat[0], r->flat[1], r->flat[2], r->flat[3], FLAT);
}

static void run_march(void *user)
{
    rig *r = user;
    const cn_march march = { 0.05f, 20, 1 + 1.0f / 256, 0.3f };
    r->marched = 0;
    for (size_t i = 0; i < RAYS; i++)
        r->marched += r->kernel->march(&r->rays[i], &march, r->occ, r->length, SAMPLES);
}

static void run_place(void *user)
{
    const rig *r = user;
    for (size_t i = 0; i < RAYS; i++)
        r->kernel->place(&r->rays[i], r->t, RAY_SAMPLES, (cn_spacing){ 1.0f / 256, 1 },
                         (cn_lanes){ r->pos, i * RAY_SAMPLES }, r->length);
}

/* ---- the buffers ---- */

static void fill(float *x, size_t n, float low, float high, unsigned stream)
{
    for (size_t i = 0; i < n; i++)
        x[i] = low + (high - low) * cn_rng_float(7, stream, i);
}

static void carve(rig *r, cn_arena *a)
{
    const size_t entries = r->field.entries;
    r->weights = CN_ARENA_NEW(a, float, r->field.n_weights);
    r->transposed = CN_ARENA_NEW(a, float, r->field.n_weights);
    r->dw = CN_ARENA_NEW(a, float, r->field.n_weights);
    r->pos = CN_ARENA_NEW(a, float, 3 * SAMPLES);
    r->length = CN_ARENA_NEW(a, float, SAMPLES);
    r->t = CN_ARENA_NEW(a, float, SAMPLES);
    r->enc = CN_ARENA_NEW(a, float, (size_t)SAMPLES * r->field.enc_rows);
    r->d_logit = CN_ARENA_NEW(a, float, MLP_PANELS *CN_PANEL);
    r->grad = CN_ARENA_NEW(a, float, (size_t)2 << LOG2_TABLE);
    r->pattern = CN_ARENA_NEW(a, float, (size_t)2 << LOG2_TABLE);
    r->touched = CN_ARENA_NEW(a, uint8_t, (size_t)1 << LOG2_TABLE);
    r->table = CN_ARENA_NEW(a, uint16_t, 2 * entries);
    r->state = CN_ARENA_NEW(a, uint16_t, (2 * entries / 16 + 1) * CN_STATE_BLOCK);
    r->occ = CN_ARENA_NEW(a, uint32_t, CN_OCC_CELLS / 32);
    for (int i = 0; i < 4; i++)
        r->flat[i] = CN_ARENA_NEW(a, float, FLAT);
    r->field.type->acts_take(&r->field, a, MLP_PANELS, &r->acts);
    r->field.type->acts_take(&r->field, a, MLP_PANELS, &r->d);
}

static cn_status make(rig *r)
{
    const cn_field_options config = hash_options((hash_sizes){ .levels = 16,
                                                               .log2_table = LOG2_TABLE,
                                                               .base_resolution = 16,
                                                               .finest_resolution = 4096,
                                                               .density_width = 64,
                                                               .colour_width = 64 });
    CN_TRY(cn_field_layout(&r->field, &config, (cn_field_inputs){ .n = 16 }));
    cn_arena counter;
    cn_arena_count(&counter);
    carve(r, &counter);
    CN_TRY(cn_arena_init(&r->arena, counter.used));
    carve(r, &r->arena);
    float *table = calloc(2 * r->field.entries, sizeof *table);
    if (!table) return cn_fail(CN_ERR_NOMEM, "out of memory");
    r->field.type->init(&r->field, 1, table, r->weights);
    for (size_t i = 0; i < 2 * r->field.entries; i++)
        r->table[i] = cn_bf16_from_float(table[i]);
    free(table);
    r->field.type->prepare(&r->field, r->weights, r->transposed);
    for (size_t i = 0; i < RAYS; i++) {
        fill(r->rays[i].origin, 3, -0.5f, 0.5f, 100 + (unsigned)i);
        fill(r->rays[i].dir, 3, -0.5f, 0.5f, 100000 + (unsigned)i);
    }
    /* The samples of a ray are a 256th of the distance apart, as in training. */
    r->t[0] = 1;
    for (size_t i = 1; i < RAY_SAMPLES; i++)
        r->t[i] = r->t[i - 1] * (1 + 1.0f / 256);
    for (size_t i = 0; i < CN_OCC_CELLS / 32; i++)
        r->occ[i] = i % 4 ? 0 : 0xffffffffu;
    fill(r->acts.own[CN_MLP_COLOUR0], (size_t)MLP_PANELS * 64 * CN_PANEL, -1, 1, 1);
    fill(r->acts.enc, (size_t)MLP_PANELS * r->field.enc_rows * CN_PANEL, -1, 1, 2);
    fill(r->acts.in, (size_t)MLP_PANELS * r->field.colour_in * CN_PANEL, -1, 1, 3);
    fill(r->d.own[CN_MLP_COLOUR1], (size_t)MLP_PANELS * 64 * CN_PANEL, -1, 1, 4);
    fill(r->d.out, (size_t)MLP_PANELS * 4 * CN_PANEL, -1, 1, 5);
    return CN_OK;
}

/* ---- the table ---- */

static double mlp_macs(const cn_field *f)
{
    double n = 0;
    for (int l = 0; l < CN_LAYERS; l++)
        n += (double)f->mlp.layer[l].out * f->mlp.layer[l].in;
    return n;
}

static void bench_mlp(rig *r, const limits *limit)
{
    static const struct {
        const char *name;
        int layer;
    } gemms[] = { { "gemm 64x32", CN_LAYER_DENSITY0 },
                  { "gemm 16x64", CN_LAYER_DENSITY1 },
                  { "gemm 64x64", CN_LAYER_COLOUR1 },
                  { "gemm 4x64", CN_LAYER_COLOUR2 } };
    const double samples = MLP_PANELS * CN_PANEL;
    for (size_t i = 0; i < sizeof gemms / sizeof *gemms; i++) {
        const cn_layer *l = &r->field.mlp.layer[gemms[i].layer];
        const double flops = 2.0 * l->out * l->in;
        r->level = (uint32_t)gemms[i].layer;
        row(gemms[i].name, r, bench_median(run_gemm, r) / samples * 1e9, flops, 4.0 * (l->out + l->in), "multiply-adds",
            flops / limit->fma);
    }
    const double grad = 2 * 64 * 64, all = 3 * 2 * mlp_macs(&r->field);
    row("weight_grad 64x64", r, bench_median(run_weight_grad, r) / samples * 1e9, grad, 4 * 128, "multiply-adds",
        grad / limit->fma);
    /* The figure that a bar is set for: its limit is measured on both sides of it, for the processor's clock wanders.
     */
    const double before = bench_fma_peak(r->kernel->name), took = bench_median(run_mlp, r),
                 after = bench_fma_peak(r->kernel->name);
    row("MLP forward and backward", r, took / samples * 1e9, all, 0, "multiply-adds", all / (0.5 * (before + after)));
}

static void bench_grid(rig *r, const limits *limit)
{
    const uint32_t levels = r->field.grid.n_levels;
    double forward = 0, backward = 0, read = 0, update = 0;
    run_place(r);
    for (r->level = 0; r->level < levels; r->level++) {
        forward += bench_median(run_encode, r) / SAMPLES * 1e9;
        read += bench_lines(r->field.grid.level[r->level].hashed) * limit->read[r->level];
    }
    fill(r->enc, (size_t)SAMPLES * r->field.enc_rows, -1, 1, 6);
    for (r->level = 0; r->level < levels; r->level++) {
        backward += bench_median(run_encode_backward, r) / SAMPLES * 1e9;
        update += bench_gradient_lines(r->field.grid.level[r->level].hashed) * limit->update[r->level];
    }
    row("encode", r, forward, 8 * 7.0 * levels, 32.0 * levels, "random reads", read);
    row("encode_backward", r, backward, 8 * 7.0 * levels, 128.0 * levels, "random updates", update);
}

static void bench_adam(rig *r, const limits *limit)
{
    const size_t n = (size_t)2 << LOG2_TABLE;
    uint32_t hashed = 0;
    for (uint32_t l = 0; l < r->field.grid.n_levels; l++)
        hashed += r->field.grid.level[l].hashed;
    for (unsigned every = 1; every <= 3; every += 2) {
        for (size_t i = 0; i < n; i++)
            r->pattern[i] = cn_rng_below(7, 9, i / 16, every) == 0 ? 1e-3f : 0;
        /* Read and written: 8 bytes of table and state of the parameters in question. The gradients stay in the cache.
         */
        const double bytes = 16.0 / every;
        row(every == 1 ? "adam_table all" : "adam_table every 3rd", r,
            bench_median(run_adam_table, r) / (double)(n * hashed) * 1e9, 14.0 / every, bytes, "memory stream",
            bytes / limit->stream);
    }
    row("adam", r, bench_median(run_adam, r) / FLAT * 1e9, 14, 32, "memory stream", 32 / limit->stream);
}

static void bench_rays(rig *r, const limits *limit)
{
    /* Operations of a step: place 6, contraction 18, cell 9. A step that is not taken costs the same. */
    const double steps = RAYS * 1539.0, flops = 33;
    row("march a step", r, bench_median(run_march, r) / steps * 1e9, flops, 4, "multiply-adds", flops / limit->fma);
    row("place", r, bench_median(run_place, r) / SAMPLES * 1e9, 26, 20, "multiply-adds", 26 / limit->fma);
}

int main(int argc, char **argv)
{
    static rig r;
    limits limit = { 0 };
    const cn_kernel *sets[4];
    const int n_sets = cn_kernel_sets(sets);
    const bool quick = argc > 1 && strcmp(argv[1], "--quick") == 0;
    const char *file = argc > 1 + quick ? argv[1 + quick] : NULL;
    if (quick) bench_repeats = 5;
    if (make(&r) != CN_OK || (file && !(csv = fopen(file, "w")))) {
        fprintf(stderr, "bench_field: %s\n", file && !csv ? "the file cannot be written" : cn_error_message());
        return 1;
    }
    limit.stream = bench_stream();
    for (uint32_t l = 0; l < r.field.grid.n_levels; l++) {
        limit.read[l] = bench_random_read((size_t)r.field.grid.level[l].entries * 4);
        limit.update[l] = bench_random_update((size_t)r.field.grid.level[l].entries * 8);
    }
    printf("Kernels, one thread. Memory stream %.1f GB/s (read and written); random reads in 2 MB %.2f ns, updates in "
           "4 MB %.2f ns.\n",
           limit.stream, limit.read[r.field.grid.n_levels - 1], limit.update[r.field.grid.n_levels - 1]);
    for (int s = 0; s < n_sets; s++)
        printf("Multiply-adds, %s: %.1f GFLOP/s.\n", sets[s]->name, bench_fma_peak(sets[s]->name));
    printf("\n| %-23s | %-10s | %9s | %7s | %6s | %-14s | %8s | reached |\n", "kernel", "set", "ns/sample", "GFLOP/s",
           "GB/s", "limit", "ns at it");
    printf("|---|---|---|---|---|---|---|---|\n");
    if (csv) fprintf(csv, "kernel,set,ns_per_sample,gflops,gb_per_s,limit,limit_ns,share\n");
    for (int s = 0; s < n_sets; s++) {
        r.kernel = sets[s];
        limit.fma = bench_fma_peak(sets[s]->name);
        bench_mlp(&r, &limit);
        bench_grid(&r, &limit);
        bench_adam(&r, &limit);
        bench_rays(&r, &limit);
    }
    cn_arena_deinit(&r.arena);
    return csv && fclose(csv) ? 1 : 0;
}
