/* Long runs and large tables: ten million steps of Adam, a training whose counter stands at ten million, tables of 2^24
 * entries. */
#include "../unit/field/options.h"
#include "hard.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { N = 16, LONG = 10000000 };

static float target_of(int i)
{
    return (float)(i % 4) - 1.5f;
}
/* Gradients from 1 down to 1e-13. The last parameter never has a gradient. */
static double strength_of(int i)
{
    return i == N - 1 ? 0 : pow(10, -13.0 * i / (N - 2));
}

/* Does ten million steps in float on 16 parameters, and for three of them also in double. Their gradients span thirteen
 * decades, with noise at first, and the rate falls as in training. All parameters reach their goal, and the one without
 * a gradient stays. Guard: the epsilon beside the root (kernel_ref.c, kernel_simd.h), which is smaller than any
 * gradient that matters. Without it a gradient that is always 0 gives 0 / 0. */
static void test_ten_million_steps(void **state)
{
    (void)state;
    const cn_kernel *k = cn_kernel_best();
    _Alignas(64) float p[N] = { 0 }, m[N] = { 0 }, v[N] = { 0 }, g[N], strength[N];
    double d[3] = { 0 }, dm[3] = { 0 }, dv[3] = { 0 }, rate = 0.01;
    const double fall = pow(1.0 / 30, 1.0 / LONG);
    for (int i = 0; i < N; i++)
        strength[i] = (float)strength_of(i);
    hard_traps_on();
    for (uint32_t step = 0; step < LONG; step++, rate *= fall) {
        const float noise = step < LONG / 10 ? (float)(int32_t)(step * 2654435769u) * 0x1p-31f : 0;
        for (int i = 0; i < N; i++)
            g[i] = strength[i] * (p[i] - target_of(i) + noise);
        const cn_adam a = { .rate = (float)rate, .beta1 = 0.9f, .beta2 = 0.99f, .epsilon = 1e-15f };
        k->adam(&a, p, m, v, g, N);
        for (int i = 0; i < 3; i++) {
            const double dg = strength_of(6 * i) * (d[i] - (double)target_of(6 * i) + (double)noise);
            dm[i] = 0.9 * dm[i] + 0.1 * dg;
            dv[i] = 0.99 * dv[i] + 0.01 * dg * dg;
            d[i] -= rate * dm[i] / (sqrt(dv[i]) + 1e-15);
        }
    }
    hard_traps_off();
    for (int i = 0; i < N; i++) {
        assert_true(isfinite(p[i]) && isfinite(m[i]) && isfinite(v[i]));
        if (i == N - 1)
            assert_true(p[i] == 0);
        else
            assert_true(fabsf(p[i] - target_of(i)) < 2e-3f);
    }
    for (int i = 0; i < 3; i++) {
        print_message("strength %g: %.6f, in double %.6f\n", strength_of(6 * i), (double)p[6 * i], d[i]);
        assert_true(fabs(d[i] - (double)p[6 * i]) < 2e-3);
    }
}

static void begin_at(hard_run *run, const synthetic_scene *synthetic, const cn_train_options *o, uint32_t step)
{
    hard_run_init(run, synthetic, o, NULL);
    run->t.step = step;
}

static void steps(hard_run *run, int n)
{
    for (int i = 0; i < n; i++) {
        hard_traps_on();
        hard_must(cn_trainer_step(&run->t));
        hard_traps_off();
    }
}

/* A training whose counter is at ten million, as a checkpoint would set it. Its steps learn and draw new rays. A resume
 * in the middle ends with the same bytes. Guards: the counter of the random numbers has 64 bits (train/step.c; with 32
 * bits the rays repeat every 2^19 steps), and a checkpoint restores the step (train/checkpoint.c). */
static void test_counter(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    hard_run a, b;
    char path[96], other[96];
    const uint32_t at = LONG;
    hard_scene_init(&synthetic, 3);
    cn_train_options o = hard_options();
    o.steps = at + 64;
    begin_at(&a, &synthetic, &o, at);
    begin_at(&b, &synthetic, &o, at - (1u << 19));
    steps(&a, 1);
    steps(&b, 1);
    assert_true(a.t.batch.n_rays == b.t.batch.n_rays);
    assert_true(memcmp(a.t.batch.dirs, b.t.batch.dirs, sizeof(float) * 3 * a.t.batch.n_rays) != 0);
    hard_run_deinit(&b);
    steps(&a, 20);
    assert_true(hard_finite(&a) && a.t.monitor.skipped == 0);
    snprintf(path, sizeof path, "%s/middle.safetensors", synthetic.folder);
    hard_must(cn_trainer_save_checkpoint(&a.t, "key", path));
    const float before = a.t.parameters.value[0];
    steps(&a, 20);
    assert_true(a.t.parameters.value[0] != before);
    snprintf(other, sizeof other, "%s/end.safetensors", synthetic.folder);
    hard_must(cn_trainer_save_checkpoint(&a.t, "key", other));
    hard_run_deinit(&a);
    bool resumed;
    hard_run_init(&b, &synthetic, &o, NULL);
    hard_must(cn_trainer_load_checkpoint(&b.t, "key", path, &resumed));
    assert_true(resumed && b.t.step == at + 21);
    steps(&b, 20);
    hard_must(cn_trainer_save_checkpoint(&b.t, "key", path));
    assert_true(same_bytes(path, other));
    hard_run_deinit(&b);
    synthetic_scene_deinit(&synthetic);
}

/* Levels of 2^24 entries are laid out without an integer overflow, and their memory is right; 2^25 are refused. Guard:
 * the vertices of a level are counted in double (field/grid.c). In 32 bits a resolution of 2046 has 2^33 = 0 vertices,
 * and one of 65534 fits any table. */
static void test_layout_of_large_tables(void **state)
{
    (void)state;
    cn_field f;
    cn_field_options c = hash_options((hash_sizes){ .levels = 24,
                                                    .log2_table = 24,
                                                    .base_resolution = 254,
                                                    .finest_resolution = 1u << 20,
                                                    .density_width = 64,
                                                    .colour_width = 64 });
    hard_must(cn_field_layout(&f, &c, (cn_field_inputs){ 0 }));
    for (uint32_t l = 0; l < 24; l++) {
        assert_true(f.grid.level[l].entries > 0 && f.grid.level[l].entries <= 1u << 24);
        if (l)
            assert_true(f.grid.level[l].hashed &&
                        f.grid.level[l].offset == f.grid.level[l - 1].offset + f.grid.level[l - 1].entries);
    }
    assert_true(f.entries == 24u << 24);
    field_set(&c, "levels", 2);
    field_set(&c, "base_resolution", 2046);
    field_set(&c, "finest_resolution", 65534);
    hard_must(cn_field_layout(&f, &c, (cn_field_inputs){ 0 }));
    assert_true(f.grid.level[0].hashed && f.grid.level[1].hashed && f.entries == 2u << 24);
    field_set(&c, "log2_table", 25);
    assert_int_equal(cn_field_layout(&f, &c, (cn_field_inputs){ 0 }), CN_ERR_CONFIG);
    cn_train_options o = hard_options();
    field_set(&o.field, "levels", 24);
    field_set(&o.field, "log2_table", 24);
    field_set(&o.field, "base_resolution", 254);
    field_set(&o.field, "finest_resolution", 1u << 20);
    const cn_plan_tile tile = { .near_m = 1, .far_m = 2 };
    double seconds;
    uint64_t bytes;
    cn_train_cost(&o, &tile, &seconds, &bytes);
    assert_true(bytes > 16ull * (24u << 24) &&
                bytes < 64ull * (24u << 24)); /* an entry of the table takes 4 bytes, and 12 for its state */
}

static uint32_t touched(const hard_run *run, uint32_t level, uint32_t first, uint32_t end)
{
    uint32_t n = 0;
    for (uint32_t i = first; i < end; i++)
        n += cn_state_at(cn_parameters_state(&run->t.parameters, level), 2 * (size_t)i)[CN_STATE_M] != 0;
    return n;
}

/* A table of 2^24 entries is trained, in its upper half as in its lower. A resume in the middle keeps its content.
 * Guards: the same, without which the level counts as dense; and a checkpoint restores the step. */
static void test_large_table(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    hard_run run;
    char path[96];
    hard_scene_init(&synthetic, 3);
    cn_train_options o = hard_options();
    field_set(&o.field, "levels", 2);
    field_set(&o.field, "log2_table", 24);
    field_set(&o.field, "finest_resolution", 2046);
    hard_run_init(&run, &synthetic, &o, NULL);
    const cn_level *level = &run.t.parameters.field.grid.level[1];
    assert_true(level->hashed && level->entries == 1u << 24);
    steps(&run, 3);
    snprintf(path, sizeof path, "%s/large.safetensors", synthetic.folder);
    hard_must(cn_trainer_save_checkpoint(&run.t, "key", path));
    steps(&run, 3);
    const uint32_t low = touched(&run, 1, 0, 1u << 23), high = touched(&run, 1, 1u << 23, 1u << 24);
    print_message("entries with a gradient: %u in the lower half, %u in the upper\n", low, high);
    assert_true(low > 1000 && high > low / 2 && high < low * 2);
    assert_true(cn_parameters_finite(&run.t.parameters) && run.t.monitor.skipped == 0);
    const size_t size = run.t.parameters.table_n * sizeof *run.t.parameters.table;
    void *table = malloc(size);
    bool resumed;
    assert_non_null(table);
    memcpy(table, run.t.parameters.table, size);
    hard_must(cn_trainer_load_checkpoint(&run.t, "key", path, &resumed));
    assert_true(resumed && run.t.step == 3 && memcmp(table, run.t.parameters.table, size) != 0);
    steps(&run, 3);
    assert_memory_equal(table, run.t.parameters.table, size);
    free(table);
    hard_run_deinit(&run);
    synthetic_scene_deinit(&synthetic);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_ten_million_steps),
        cmocka_unit_test(test_counter),
        cmocka_unit_test(test_layout_of_large_tables),
        cmocka_unit_test(test_large_table),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
