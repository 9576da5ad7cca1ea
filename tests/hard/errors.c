/* Each kernel's error against doubles, for random inputs and for difficult ones. Prints a table and checks bounds.
 *   test_hard_errors     prints it for every instruction set of this machine
 * Errors are relative to what the sum would be if nothing cancelled (gemm, weight_grad, encode, encode_backward), to
 * the distance (march), to the cube (place), to the step (adam). The bound is per instruction set: half a unit in the
 * last place, 6e-8, times the length of the sum; 2^-8 where factors are rounded to bfloat16. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/rng.h"
#include "doubles.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { M = 64, K = 64, PANELS = 8 };
#define ULP 6e-8
/* Both factors are rounded to 8 bits, each by 2^-8 at most. A sum of one product has the full error. */
#define BF16_PRODUCT ((1 + 0x1p-8) * (1 + 0x1p-8) - 1)

static const cn_kernel *sets[4];
static int n_sets;

typedef struct error {
    double worst, sum;
    uint64_t n;
} error;
static void note(error *e, double off)
{
    if (!(off <= e->worst)) e->worst = off; /* NaN is kept */
    e->sum += off;
    e->n++;
}

static void report(const cn_kernel *k, const char *kernel, const char *inputs, const error *e, double bound)
{
    printf("%-12s %-16s %-22s %10.2e %10.2e %10.2e\n", k->name, kernel, inputs, e->worst, e->sum / (double)e->n, bound);
    fflush(stdout);
    if (!(e->worst <= bound))
        fail_msg("%s %s, %s: %g is past its bound of %g", k->name, kernel, inputs, e->worst, bound);
}

static float uniform(unsigned stream, size_t i)
{
    return 2 * cn_rng_float(7, stream, i) - 1;
}

/* Numbers of one kind: plain, of all sizes, or such that sums cancel. */
typedef enum kind { PLAIN, SIZES, CANCEL, KINDS } kind;
static const char *const kind_names[KINDS] = { "random", "sizes 1e-6 to 1e6", "sums that cancel" };
static float number(kind what, unsigned stream, size_t i, size_t row)
{
    const float x = uniform(stream, i);
    if (what == SIZES) return x * exp2f(40 * cn_rng_float(7, stream + 100, i) - 20);
    if (what == CANCEL) return (1 + 1e-3f * x) * (row % 2 ? -1 : 1);
    return x;
}

static void test_gemm(void **state)
{
    (void)state;
    static float a[K * M], x[K * CN_PANEL], y[M * CN_PANEL];
    for (int s = 0; s < n_sets; s++)
        for (kind what = PLAIN; what < KINDS; what++) {
            error e = { 0 };
            for (size_t i = 0; i < K * M; i++)
                a[i] = number(what == CANCEL ? PLAIN : what, 1, i, 0);
            if (what == CANCEL)
                for (size_t i = 0; i < K * M; i++)
                    a[i] = 1 + 1e-3f * a[i];
            for (size_t i = 0; i < K * CN_PANEL; i++)
                x[i] = number(what, 2, i, i / CN_PANEL);
            sets[s]->gemm((cn_matrix){ a, M, K }, x, y, NULL, false);
            for (size_t m = 0; m < M; m++)
                for (size_t lane = 0; lane < CN_PANEL; lane++) {
                    double sum = 0, size = 0;
                    for (size_t k = 0; k < K; k++) {
                        const double term = (double)a[k * M + m] * (double)x[k * CN_PANEL + lane];
                        sum += term;
                        size += fabs(term);
                    }
                    note(&e, fabs((double)y[m * CN_PANEL + lane] - sum) / size);
                }
            report(sets[s], "gemm", kind_names[what], &e,
                   strcmp(sets[s]->name, "avx512bf16") == 0 ? BF16_PRODUCT + K * ULP : K * ULP);
        }
}

static void test_weight_grad(void **state)
{
    (void)state;
    static float dy[PANELS * M * CN_PANEL], x[PANELS * K * CN_PANEL], dw[M * K];
    for (int s = 0; s < n_sets; s++)
        for (kind what = PLAIN; what < KINDS; what++) {
            error e = { 0 };
            for (size_t i = 0; i < PANELS * M * CN_PANEL; i++)
                dy[i] = number(what, 3, i, i % CN_PANEL);
            for (size_t i = 0; i < PANELS * K * CN_PANEL; i++)
                x[i] = what == CANCEL ? 1 + 1e-3f * uniform(4, i) : number(what, 4, i, 0);
            memset(dw, 0, sizeof dw);
            sets[s]->weight_grad(&(cn_panel_rows){ dy, M * CN_PANEL, M }, &(cn_panel_rows){ x, K * CN_PANEL, K },
                                 PANELS, dw);
            for (size_t m = 0; m < M; m += 3)
                for (size_t k = 0; k < K; k += 3) {
                    double sum = 0, size = 0;
                    for (size_t p = 0; p < PANELS; p++)
                        for (size_t lane = 0; lane < CN_PANEL; lane++) {
                            const double term =
                                (double)dy[(p * M + m) * CN_PANEL + lane] * (double)x[(p * K + k) * CN_PANEL + lane];
                            sum += term;
                            size += fabs(term);
                        }
                    note(&e, fabs((double)dw[m * K + k] - sum) / size);
                }
            report(sets[s], "weight_grad", kind_names[what], &e, 0.25 * PANELS * CN_PANEL * ULP);
        }
}

static const cn_level levels[] = {
    { .resolution = 16, .entries = 18 * 18 * 18 },
    { .resolution = 700, .entries = 1u << 14, .hashed = true },
    { .resolution = 65534, .entries = 1u << 16, .hashed = true },
};
enum { LEVELS = sizeof levels / sizeof *levels, LANES = PANELS * CN_PANEL };

/* hard: positions on vertices, beside them, on the faces of the cube, and outside. */
static void fill_positions(float *pos, const cn_level *level, bool hard)
{
    static const float odd[] = { 0, 1, -0.5f, 1.5f, 0.99999994f, 1e-30f, 0.5f };
    for (size_t p = 0; p < PANELS; p++)
        for (size_t a = 0; a < 3; a++)
            for (size_t lane = 0; lane < CN_PANEL; lane++) {
                const size_t i = (p * 3 + a) * CN_PANEL + lane;
                float x = cn_rng_float(7, 5, i);
                if (hard) {
                    x = (floorf(x * (float)level->resolution) - 0.5f) / (float)level->resolution; /* a vertex */
                    if (lane % 3 == 1) x = nextafterf(x, 2);
                    if (lane % 7 == 0) x = odd[(i / 7 + a) % 7];
                }
                pos[i] = x;
            }
}

static void position_of(const float *pos, size_t i, float out[3])
{
    for (size_t a = 0; a < 3; a++)
        out[a] = pos[(i / CN_PANEL * 3 + a) * CN_PANEL + i % CN_PANEL];
}

static void test_encode(void **state)
{
    (void)state;
    static float pos[3 * LANES], out[2 * LANES];
    for (int s = 0; s < n_sets; s++)
        for (size_t l = 0; l < 2 * LEVELS; l++) {
            const cn_level *level = &levels[l / 2];
            uint32_t *table = malloc(level->entries * sizeof *table);
            error e = { 0 };
            char what[32];
            assert_non_null(table);
            for (uint32_t i = 0; i < level->entries; i++)
                table[i] = cn_bf16_from_float(uniform(6, i)) | (uint32_t)cn_bf16_from_float(1e3f * uniform(7, i)) << 16;
            fill_positions(pos, level, l % 2);
            sets[s]->encode(level, table, pos, PANELS, out, 2 * CN_PANEL);
            for (size_t i = 0; i < LANES; i++) {
                float at[3];
                double sum[2] = { 0, 0 };
                position_of(pos, i, at);
                const double_corners c = double_corners_of(level, at);
                for (int q = 0; q < 8; q++) {
                    sum[0] += c.weight[q] * (double)cn_bf16_to_float((uint16_t)table[c.index[q]]);
                    sum[1] += c.weight[q] * (double)cn_bf16_to_float((uint16_t)(table[c.index[q]] >> 16));
                }
                const float *row = out + i / CN_PANEL * 2 * CN_PANEL + i % CN_PANEL;
                note(&e, fabs((double)row[0] - sum[0]));
                note(&e, fabs((double)row[CN_PANEL] - sum[1]) / 1e3);
            }
            snprintf(what, sizeof what, "%s, level %u", l % 2 ? "vertices" : "random", level->resolution);
            /* The fraction along an axis is off by the last place of its cell's number: there are three, and corners 2
             * apart. */
            report(sets[s], "encode", what, &e, 16 * ULP + 6 * ULP * level->resolution);
            free(table);
        }
}

static void test_encode_backward(void **state)
{
    (void)state;
    static float pos[3 * LANES], dout[2 * LANES];
    for (int s = 0; s < n_sets; s++)
        for (size_t l = 0; l < 2 * LEVELS; l++) {
            const cn_level *level = &levels[l / 2];
            const cn_range whole = { 0, level->entries };
            float *grad = calloc(2 * (size_t)level->entries, sizeof *grad);
            double *sum = calloc(level->entries, sizeof *sum), *size = calloc(level->entries, sizeof *size);
            error e = { 0 };
            char what[32];
            assert_true(grad && sum && size);
            fill_positions(pos, level, l % 2);
            for (size_t i = 0; i < 2 * LANES; i++)
                dout[i] = uniform(8, i);
            sets[s]->encode_backward(level,
                                     &(cn_encode_gradient){ pos, dout, 2 * CN_PANEL, PANELS, &whole, grad, NULL });
            for (size_t i = 0; i < LANES; i++) {
                float at[3];
                position_of(pos, i, at);
                const double_corners c = double_corners_of(level, at);
                const double d = (double)dout[i / CN_PANEL * 2 * CN_PANEL + i % CN_PANEL];
                for (int q = 0; q < 8; q++) {
                    sum[c.index[q]] += c.weight[q] * d;
                    size[c.index[q]] += fabs(d); /* a weight may be only a rounding error, so it is compared with 1 */
                }
            }
            for (uint32_t i = 0; i < level->entries; i++)
                if (size[i] > 0) note(&e, fabs((double)grad[2 * (size_t)i] - sum[i]) / size[i]);
            snprintf(what, sizeof what, "%s, level %u", l % 2 ? "vertices" : "random", level->resolution);
            report(sets[s], "encode_backward", what, &e, 16 * ULP + 4 * ULP * level->resolution);
            free(grad), free(sum), free(size);
        }
}

static void test_march_and_place(void **state)
{
    (void)state;
    enum { ROOM = 12000 };
    static uint32_t full[CN_OCC_CELLS / 32];
    static float t[ROOM], pos[(ROOM / CN_PANEL + 1) * 3 * CN_PANEL], length[ROOM];
    static const cn_box_ray rays[][2] = {
        { { { 0.1f, -0.3f, 0.2f }, { 0.2f, 0.1f, -0.15f } }, { { -0.5f, 0.4f, 0 }, { 0.05f, 0.3f, 0.3f } } },
        { { { 1, 1, 1 }, { -0.57735f, -0.57735f, -0.57735f } }, { { 0, 1, 0 }, { 1, 0, 0 } } }
    };
    memset(full, 0xff, sizeof full);
    for (int s = 0; s < n_sets; s++)
        for (int hard = 0; hard < 2; hard++) {
            error march = { 0 }, place = { 0 }, lengths = { 0 };
            const double step = hard ? 1e-3 : 1.0 / 128;
            for (int r = 0; r < 2; r++) {
                const cn_box_ray *ray = &rays[hard][r];
                const cn_march m = { 0.5f, hard ? 1e4f : 100, (float)(1 + step), 0.25f };
                const uint32_t n = sets[s]->march(ray, &m, full, t, ROOM);
                assert_true(n > 600 && n < ROOM);
                sets[s]->place(ray, t, n, (cn_spacing){ (float)step, 0.5f }, (cn_lanes){ pos, 0 }, length);
                for (uint32_t i = 0; i < n; i++) {
                    const double want = 0.5 * pow((double)m.ratio, (double)i + 0.25);
                    double x[3], u[3];
                    float at[3];
                    note(&march, fabs((double)t[i] / want - 1));
                    for (int a = 0; a < 3; a++)
                        x[a] = (double)ray->origin[a] + (double)t[i] * (double)ray->dir[a];
                    const double scale = double_contract(x, u);
                    position_of(pos, i, at);
                    for (int a = 0; a < 3; a++)
                        note(&place, fabs((double)at[a] - u[a]));
                    note(&lengths, fabs((double)length[i] / ((double)(float)step * (double)t[i] * 0.5 * scale) - 1));
                }
            }
            report(sets[s], "march", hard ? "10,000 steps" : "random", &march, hard ? 2e-4 : 1e-5);
            report(sets[s], "place", hard ? "faces, corners, far" : "random", &place, 4 * ULP);
            report(sets[s], "place (length)", hard ? "faces, corners, far" : "random", &lengths, 2e-6);
        }
}

enum { PARAMETERS = 4096, STEPS = 100 };
static const cn_adam adam = { .rate = 0.01f, .beta1 = 0.9f, .beta2 = 0.99f, .epsilon = 1e-15f };
static float adam_gradient(bool hard, size_t i, int step)
{
    const float g = uniform(20 + (unsigned)step, i);
    return hard ? g * powf(10, -(float)(i % 19)) : g;
}

/* A hundred steps. The error is that of the parameter, over the longest way that it could have moved. */
static void test_adam(void **state)
{
    (void)state;
    static float p[PARAMETERS], m[PARAMETERS], v[PARAMETERS], g[PARAMETERS];
    static double dp[PARAMETERS], dm[PARAMETERS], dv[PARAMETERS];
    for (int s = 0; s < n_sets; s++)
        for (int hard = 0; hard < 2; hard++) {
            error e = { 0 };
            memset(m, 0, sizeof m), memset(v, 0, sizeof v), memset(dm, 0, sizeof dm), memset(dv, 0, sizeof dv);
            for (size_t i = 0; i < PARAMETERS; i++)
                dp[i] = (double)(p[i] = uniform(19, i));
            for (int step = 0; step < STEPS; step++) {
                for (size_t i = 0; i < PARAMETERS; i++) {
                    const double grad = (double)(g[i] = adam_gradient(hard, i, step));
                    dm[i] = 0.9 * dm[i] + 0.1 * grad;
                    dv[i] = 0.99 * dv[i] + 0.01 * grad * grad;
                    dp[i] -= 0.01 * dm[i] / (sqrt(dv[i]) + 1e-15);
                }
                sets[s]->adam(&adam, p, m, v, g, PARAMETERS);
            }
            for (size_t i = 0; i < PARAMETERS; i++)
                note(&e, fabs((double)p[i] - dp[i]) / (0.01 * STEPS));
            report(sets[s], "adam", hard ? "gradients to 1e-18" : "random", &e, 1e-5);
        }
}

/* The table's: moments of 8 bits, so a step is off by some parts in a thousand; never more, and on average by next to
 * nothing. */
static void test_adam_table(void **state)
{
    (void)state;
    static uint16_t table[PARAMETERS], states[PARAMETERS / 16 * CN_STATE_BLOCK];
    static float g[PARAMETERS];
    static double dp[PARAMETERS], dm[PARAMETERS], dv[PARAMETERS];
    for (int s = 0; s < n_sets; s++)
        for (int hard = 0; hard < 2; hard++) {
            error e = { 0 };
            memset(states, 0, sizeof states), memset(dm, 0, sizeof dm), memset(dv, 0, sizeof dv);
            for (size_t i = 0; i < PARAMETERS; i++) {
                const float p = uniform(19, i);
                dp[i] = (double)p;
                cn_float_split(p, &table[i], cn_state_at(states, i));
            }
            for (int step = 0; step < STEPS; step++) {
                cn_adam now = adam;
                now.dither = ((uint32_t)step * 2654435769u) >> 16;
                for (size_t i = 0; i < PARAMETERS; i++) {
                    const double grad = (double)(g[i] = adam_gradient(hard, i, step));
                    dm[i] = 0.9 * dm[i] + 0.1 * grad;
                    dv[i] = 0.99 * dv[i] + 0.01 * grad * grad;
                    dp[i] -= 0.01 * dm[i] / (sqrt(dv[i]) + 1e-15);
                }
                sets[s]->adam_table(&now, table, states, g, NULL, PARAMETERS);
            }
            for (size_t i = 0; i < PARAMETERS; i++)
                note(&e, fabs((double)cn_float_join(table[i], *cn_state_at(states, i)) - dp[i]) / (0.01 * STEPS));
            report(sets[s], "adam_table", hard ? "gradients to 1e-18" : "random", &e, 1.0 / 64);
        }
}

int main(void)
{
    n_sets = cn_kernel_sets(sets);
    printf("%-12s %-16s %-22s %10s %10s %10s\n", "set", "kernel", "inputs", "worst", "mean", "bound");
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_gemm),
        cmocka_unit_test(test_weight_grad),
        cmocka_unit_test(test_encode),
        cmocka_unit_test(test_encode_backward),
        cmocka_unit_test(test_march_and_place),
        cmocka_unit_test(test_adam),
        cmocka_unit_test(test_adam_table),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
