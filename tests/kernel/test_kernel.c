/* Compares every instruction set with the reference, entry by entry: random sizes, odd tails, misaligned buffers that
 * end at guard pages. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#ifdef CN_EMULATED
#include "emulated.h"
#endif
#include "guard.h"
#include "kernel/kernel.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static const cn_kernel *set; /* the set under test */
static int runs;             /* kernels of it that were compared */

static void assert_close(const float *a, const float *b, size_t n, float relative, float absolute)
{
    for (size_t i = 0; i < n; i++)
        if (!(fabsf(a[i] - b[i]) <= absolute + relative * fabsf(b[i])))
            fail_msg("value %zu: %.9g, the reference has %.9g", i, (double)a[i], (double)b[i]);
}

static void test_gemm(void **state)
{
    (void)state;
    static const unsigned shapes[][2] = { { 4, 1 },   { 4, 64 },  { 16, 64 }, { 64, 32 },
                                          { 64, 33 }, { 64, 64 }, { 60, 7 },  { 128, 128 } };
    for (size_t c = 0; c < sizeof shapes / sizeof *shapes; c++) {
        for (int mode = 0; mode < 3; mode++) {
            const unsigned m = shapes[c][0], k = shapes[c][1];
            guarded a = guarded_floats((size_t)m * k), x = guarded_floats((size_t)k * CN_PANEL);
            guarded y = guarded_floats((size_t)m * CN_PANEL), want = guarded_floats((size_t)m * CN_PANEL);
            guarded gate = guarded_floats((size_t)m * CN_PANEL);
            fill_random(a.data, (size_t)m * k, -1, 1, 1);
            fill_random(x.data, (size_t)k * CN_PANEL, -1, 1, 2);
            fill_random(gate.data, (size_t)m * CN_PANEL, -1, 1, 3);
            const float *g = mode == 2 ? gate.data : NULL;
            cn_kernel_ref.gemm((cn_matrix){ a.data, m, k }, x.data, want.data, g, mode == 1);
            set->gemm((cn_matrix){ a.data, m, k }, x.data, y.data, g, mode == 1);
            /* The relative error of a factor rounded to bfloat16 is at most 2^-9. */
            const float off = strcmp(set->name, "avx512bf16") == 0 ? 1.0f / 256 : 1e-5f;
            assert_close(y.data, want.data, (size_t)m * CN_PANEL, 1e-5f, off * (float)k);
            guarded_free(&a), guarded_free(&x), guarded_free(&y), guarded_free(&want), guarded_free(&gate);
        }
    }
    runs++;
}

static void test_weight_grad(void **state)
{
    (void)state;
    static const unsigned shapes[][3] = { { 4, 4, 1 },   { 64, 32, 3 }, { 16, 64, 4 }, { 4, 64, 5 },
                                          { 64, 36, 2 }, { 64, 64, 9 }, { 8, 20, 3 },  { 16, 72, 1 } };
    for (size_t c = 0; c < sizeof shapes / sizeof *shapes; c++) {
        const unsigned m = shapes[c][0], k = shapes[c][1], n = shapes[c][2];
        guarded dy = guarded_floats((size_t)m * CN_PANEL * n), x = guarded_floats((size_t)k * CN_PANEL * n);
        guarded a = guarded_floats((size_t)m * k), b = guarded_floats((size_t)m * k);
        fill_random(dy.data, (size_t)m * CN_PANEL * n, -1, 1, 4);
        fill_random(x.data, (size_t)k * CN_PANEL * n, -1, 1, 5);
        fill_random(a.data, (size_t)m * k, -1, 1, 6);
        fill_random(b.data, (size_t)m * k, -1, 1, 6);
        cn_kernel_ref.weight_grad(&(cn_panel_rows){ dy.data, (size_t)m * CN_PANEL, m },
                                  &(cn_panel_rows){ x.data, (size_t)k * CN_PANEL, k }, n, a.data);
        set->weight_grad(&(cn_panel_rows){ dy.data, (size_t)m * CN_PANEL, m },
                         &(cn_panel_rows){ x.data, (size_t)k * CN_PANEL, k }, n, b.data);
        assert_close(b.data, a.data, (size_t)m * k, 1e-5f, 2e-4f);
        guarded_free(&dy), guarded_free(&x), guarded_free(&a), guarded_free(&b);
    }
    runs++;
}

static const cn_level levels[] = {
    { .resolution = 16, .entries = 18 * 18 * 18 },
    { .resolution = 5, .entries = 7 * 7 * 7 + 1 },
    { .resolution = 700, .entries = 1u << 14, .hashed = true },
    { .resolution = 4096, .entries = 1u << 19, .hashed = true },
};

static guarded random_table(const cn_level *level)
{
    guarded table = guarded_floats(level->entries);
    for (uint32_t i = 0; i < level->entries; i++) {
        float pair[2];
        fill_random(pair, 2, -1, 1, 7 + i);
        const uint32_t word = cn_bf16_from_float(pair[0]) | (uint32_t)cn_bf16_from_float(pair[1]) << 16;
        memcpy(table.data + i, &word, 4);
    }
    return table;
}

/* Positions inside, on the faces, outside, and not a number: nothing may be read past the table. */
static guarded hard_positions(size_t panels)
{
    guarded pos = guarded_floats(panels * 3 * CN_PANEL);
    fill_random(pos.data, panels * 3 * CN_PANEL, 0, 1, 8);
    /* Neighbours that share cells, as along a ray. */
    for (size_t a = 0; a < 3; a++)
        for (size_t i = 16; i < CN_PANEL; i++)
            pos.data[a * CN_PANEL + i] = pos.data[a * CN_PANEL + i / 5 * 5];
    static const float odd[] = { 0, 1, -0.5f, 1.5f, 0.99999994f, 1e-30f, INFINITY, -INFINITY, NAN, 0.5f };
    for (size_t i = 0; i < sizeof odd / sizeof *odd; i++)
        for (size_t a = 0; a < 3; a++)
            pos.data[a * CN_PANEL + i] = odd[(i + a * 3) % 10];
    return pos;
}

static void test_encode(void **state)
{
    (void)state;
    enum { PANELS = 3, STRIDE = 6 * CN_PANEL };
    for (size_t l = 0; l < sizeof levels / sizeof *levels; l++) {
        guarded table = random_table(&levels[l]), pos = hard_positions(PANELS);
        guarded a = guarded_floats(PANELS * STRIDE), b = guarded_floats(PANELS * STRIDE);
        const uint32_t *words = (const uint32_t *)(const void *)table.data;
        cn_kernel_ref.encode(&levels[l], words, pos.data, PANELS, a.data, STRIDE);
        set->encode(&levels[l], words, pos.data, PANELS, b.data, STRIDE);
        /* A last-bit difference of the position moves the fraction by resolution * 2^-24. */
        assert_close(b.data, a.data, PANELS * STRIDE, 1e-4f, 1e-5f + 4e-7f * (float)levels[l].resolution);
        guarded_free(&table), guarded_free(&pos), guarded_free(&a), guarded_free(&b);
    }
    runs++;
}

static void test_encode_backward(void **state)
{
    (void)state;
    enum { PANELS = 3, STRIDE = 2 * CN_PANEL };
    for (size_t l = 0; l < sizeof levels / sizeof *levels; l++) {
        const size_t n = 2 * (size_t)levels[l].entries;
        guarded pos = hard_positions(PANELS), dout = guarded_floats(PANELS * STRIDE);
        guarded a = guarded_floats(n), b = guarded_floats(n), parts = guarded_floats(n);
        fill_random(dout.data, PANELS * STRIDE, -1, 1, 9);
        for (size_t i = 0; i < PANELS * STRIDE; i += 7)
            dout.data[i] = 0;
        for (size_t i = 0; i < CN_PANEL; i += 5)
            dout.data[i] = dout.data[i + CN_PANEL] = 0;
        const uint32_t half = levels[l].entries / 2;
        const cn_range all = { 0, levels[l].entries }, low = { 0, half }, high = { half, levels[l].entries - half };
        cn_kernel_ref.encode_backward(&levels[l],
                                      &(cn_encode_gradient){ pos.data, dout.data, STRIDE, PANELS, &all, a.data, NULL });
        uint8_t *touched = calloc(levels[l].entries / CN_TOUCH + 1, 1);
        set->encode_backward(&levels[l],
                             &(cn_encode_gradient){ pos.data, dout.data, STRIDE, PANELS, &all, b.data, touched });
        assert_close(b.data, a.data, n, 1e-4f, 1e-5f + 4e-7f * (float)levels[l].resolution);
        for (size_t i = 0; i < n; i++)
            assert_true(b.data[i] == 0 || touched[i / (2 * CN_TOUCH)] == 1);
        free(touched);
        /* In parts, the same to the bit. */
        set->encode_backward(&levels[l],
                             &(cn_encode_gradient){ pos.data, dout.data, STRIDE, PANELS, &low, parts.data, NULL });
        set->encode_backward(&levels[l], &(cn_encode_gradient){ pos.data, dout.data, STRIDE, PANELS, &high,
                                                                parts.data + 2 * (size_t)half, NULL });
        assert_memory_equal(parts.data, b.data, n * sizeof(float));
        guarded_free(&pos), guarded_free(&dout), guarded_free(&a), guarded_free(&b), guarded_free(&parts);
    }
    runs++;
}

static uint32_t *random_occupancy(unsigned density)
{
    uint32_t *occ = calloc(CN_OCC_CELLS / 32, 4);
    float *x = malloc(CN_OCC_CELLS / 32 * sizeof *x);
    fill_random(x, CN_OCC_CELLS / 32, 0, 100, 10);
    for (size_t i = 0; i < CN_OCC_CELLS / 32; i++)
        occ[i] = x[i] < (float)density ? 0xffffffffu : 0;
    free(x);
    return occ;
}

static void test_march_and_place(void **state)
{
    (void)state;
    uint32_t *occ = random_occupancy(40);
    unsigned differ = 0, rays = 0;
    for (unsigned seed = 0; seed < 200; seed++) {
        float v[7], t[2][1024];
        fill_random(v, 7, -1, 1, 11 + seed);
        cn_box_ray ray = { { v[0] * 2, v[1] * 2, v[2] * 2 }, { v[3], v[4], v[5] } };
        if (seed % 10 == 0) ray.dir[0] = ray.dir[1] = 0; /* parallel to faces */
        const cn_march march = { 0.05f, 100, 1 + 1.0f / 128, 0.5f + v[6] * 0.49f };
        const uint32_t max = seed % 3 == 0 ? 17 : 1024;
        const uint32_t a = cn_kernel_ref.march(&ray, &march, occ, t[0], max);
        const uint32_t b = set->march(&ray, &march, occ, t[1], max);
        assert_true(a <= max && b <= max);
        /* t accumulates differently, so a step at a cell's face may fall to either side. */
        differ += a != b;
        rays++;
        guarded pos[2], length[2];
        for (int i = 0; i < 2; i++) {
            pos[i] = guarded_floats(3 * CN_PANEL * 24);
            length[i] = guarded_floats(a + 1);
            (i ? set : &cn_kernel_ref)
                ->place(&ray, t[0], a, (cn_spacing){ 0.01f, 0.5f }, (cn_lanes){ pos[i].data, 5 }, length[i].data);
        }
        assert_close(pos[1].data, pos[0].data, 3 * CN_PANEL * 24, 1e-5f, 1e-6f);
        assert_close(length[1].data, length[0].data, a, 1e-5f, 1e-9f);
        for (int i = 0; i < 2; i++)
            guarded_free(&pos[i]), guarded_free(&length[i]);
    }
    assert_true(differ * 5 < rays);
    runs++;
    free(occ);
}

/* Random bytes; some descriptors are 0, some 255 throughout, some repeated so that products are equal. */
static guarded random_descriptors(uint32_t n, unsigned seed)
{
    guarded g = guarded_floats((size_t)n * CN_DESCRIPTOR / 4);
    uint8_t *bytes = (uint8_t *)g.data;
    for (uint32_t i = 0; i < n; i++) {
        uint8_t *one = bytes + (size_t)i * CN_DESCRIPTOR;
        float x[CN_DESCRIPTOR];
        fill_random(x, CN_DESCRIPTOR, 0, 256, seed + i);
        for (int k = 0; k < CN_DESCRIPTOR; k++)
            one[k] = (uint8_t)x[k];
        if (i % 7 == 3) memcpy(one, bytes, CN_DESCRIPTOR);
        if (i % 11 == 5) memset(one, i % 2 ? 0 : 255, CN_DESCRIPTOR);
    }
    return g;
}

static cn_nearest nearest_in(const guarded *g, uint32_t n)
{
    int32_t *at = (int32_t *)(void *)g->data;
    return (cn_nearest){ at, at + n, at + 2 * (size_t)n };
}

static void test_match(void **state)
{
    (void)state;
    static const uint32_t sizes[][2] = { { 0, 5 },   { 5, 0 },   { 1, 1 },    { 2, 3 },    { 7, 13 },    { 17, 49 },
                                         { 48, 16 }, { 100, 1 }, { 33, 530 }, { 1, 1025 }, { 19, 1100 }, { 300, 97 } };
    for (size_t c = 0; c < sizeof sizes / sizeof *sizes; c++) {
        const uint32_t n = sizes[c][0], m = sizes[c][1];
        guarded a = random_descriptors(n, 500), b = random_descriptors(m, 900);
        guarded got = guarded_floats(3 * (size_t)n), want = guarded_floats(3 * (size_t)n);
        guarded got_columns = guarded_floats(3 * (size_t)m), want_columns = guarded_floats(3 * (size_t)m);
        const cn_descriptors rows = { (uint8_t *)a.data, n }, columns = { (uint8_t *)b.data, m };
        const cn_nearest to[] = { nearest_in(&want, n), nearest_in(&want_columns, m), nearest_in(&got, n),
                                  nearest_in(&got_columns, m) };
        cn_kernel_ref.match(rows, columns, &to[0], &to[1]);
        set->match(rows, columns, &to[2], &to[3]);
        assert_memory_equal(got.data, want.data, 3 * (size_t)n * sizeof(int32_t));
        assert_memory_equal(got_columns.data, want_columns.data, 3 * (size_t)m * sizeof(int32_t));
        guarded_free(&a), guarded_free(&b), guarded_free(&got), guarded_free(&want);
        guarded_free(&got_columns), guarded_free(&want_columns);
    }
    runs++;
}

/* What the reference itself says: two rows and three columns, with a tie and a product of 0. */
static void test_match_finds_the_two_largest(void **state)
{
    (void)state;
    uint8_t rows[2][CN_DESCRIPTOR] = { { 10 }, { 0, 255 } }, columns[3][CN_DESCRIPTOR] = { { 3 }, { 7 }, { 7, 255 } };
    int32_t r[3][2], c[3][3];
    const cn_nearest of_rows = { r[0], r[1], r[2] }, of_columns = { c[0], c[1], c[2] };
    set->match((cn_descriptors){ rows[0], 2 }, (cn_descriptors){ columns[0], 3 }, &of_rows, &of_columns);
    const int32_t want_rows[3][2] = { { 70, 255 * 255 }, { 70, 0 }, { 1, 2 } };
    const int32_t want_columns[3][3] = { { 30, 70, 255 * 255 }, { 0, 0, 70 }, { 0, 0, 1 } };
    assert_memory_equal(r, want_rows, sizeof r);
    assert_memory_equal(c, want_columns, sizeof c);
    runs++;
}

/* Homographies that keep the window inside the picture, take it over the border, and turn the plane away. */
static void test_window_sums(void **state)
{
    (void)state;
    enum { WIDTH = 37, HEIGHT = 23 };
    guarded grey = guarded_floats(WIDTH * HEIGHT);
    fill_random(grey.data, WIDTH * HEIGHT, 0, 1, 71);
    const cn_grey_picture picture = { grey.data, WIDTH, HEIGHT };
    for (unsigned seed = 0; seed < 200; seed++) {
        cn_window window;
        float h[9], sums[2][3];
        fill_random(window.x, CN_WINDOW, 0, WIDTH, 100 + seed);
        fill_random(window.y, CN_WINDOW, 0, HEIGHT, 400 + seed);
        fill_random(window.value, CN_WINDOW, 0, 1, 700 + seed);
        fill_random(window.weight, CN_WINDOW, 0, 1, 1000 + seed);
        fill_random(h, 9, -0.3f, 0.3f, 1300 + seed);
        h[0] += 1;
        h[4] += 1;
        h[2] *= seed % 3 ? 10 : 1000;
        h[6] *= 0.01f;
        h[7] *= 0.01f;
        h[8] = 1;
        cn_kernel_ref.window_sums(&window, &picture, h, sums[0]);
        set->window_sums(&window, &picture, h, sums[1]);
        assert_close(sums[1], sums[0], 3, 1e-4f, 1e-4f);
    }
    /* A homography without a meaning still reads inside the picture. */
    cn_window window = { .weight = { 1 } };
    const float none[9] = { 0 };
    float sums[3];
    set->window_sums(&window, &picture, none, sums);
    assert_close(&sums[0], grey.data, 1, 1e-6f, 0);
    runs++;
    guarded_free(&grey);
}

static void test_march_keeps_its_limits(void **state)
{
    (void)state;
    uint32_t *occ = random_occupancy(101); /* all full */
    for (int s = 0; s < 2; s++) {
        const cn_kernel *k = s ? set : &cn_kernel_ref;
        float t[64];
        const cn_box_ray ray = { { 0, 0, 0 }, { 0, 0, 1 } };
        const cn_march march = { 1, 1.5f, 1.1f, 0 }, none = { 2, 1, 1.1f, 0 };
        const uint32_t n = k->march(&ray, &march, occ, t, 64);
        assert_int_equal(n, 5); /* 1, 1.1, 1.21, 1.331, 1.4641 */
        for (uint32_t i = 0; i < n; i++)
            assert_true(t[i] >= 1 && t[i] < 1.5f);
        assert_int_equal(k->march(&ray, &none, occ, t, 64), 0); /* near past far */
    }
    free(occ);
}

static void test_adam(void **state)
{
    (void)state;
    enum { N = 1024 };
    const cn_adam adam = { .rate = 0.01f, .beta1 = 0.9f, .beta2 = 0.99f, .epsilon = 1e-15f, .decay = 1e-3f };
    guarded x[2][4];
    for (int i = 0; i < 2; i++) {
        for (int k = 0; k < 4; k++) {
            x[i][k] = guarded_floats(N);
            fill_random(x[i][k].data, N, k == 2 ? 0 : -1, 1, 20 + (unsigned)k);
        }
        (i ? set : &cn_kernel_ref)->adam(&adam, x[i][0].data, x[i][1].data, x[i][2].data, x[i][3].data, N);
    }
    for (int k = 0; k < 4; k++)
        assert_close(x[1][k].data, x[0][k].data, N, 1e-5f, 1e-6f);
    for (size_t j = 0; j < N; j++)
        assert_float_equal(x[0][3].data[j], 0, 0);
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 4; k++)
            guarded_free(&x[i][k]);
    runs++;
}

/* A table's parameters, state and gradients; every third parameter has no gradient, and some whole vectors have none.
 */
typedef struct adam_rig {
    guarded table, state, grad;
    size_t n;
} adam_rig;

static adam_rig make_adam_rig(size_t n)
{
    adam_rig r = { guarded_floats(n / 2), guarded_floats((n + 15) / 16 * CN_STATE_BLOCK / 2), guarded_floats(n), n };
    guarded p = guarded_floats(n), m = guarded_floats(n), v = guarded_floats(n);
    fill_random(p.data, n, -1, 1, 20);
    fill_random(m.data, n, -1, 1, 21);
    fill_random(v.data, n, 0, 1, 22);
    fill_random(r.grad.data, n, -1, 1, 23);
    for (size_t i = 0; i < n; i++) {
        uint16_t *at = cn_state_at((uint16_t *)(void *)r.state.data, i);
        if (i % 3 == 0 || i / 64 == 1) r.grad.data[i] = 0;
        cn_float_split(p.data[i], (uint16_t *)(void *)r.table.data + i, &at[0]);
        at[CN_STATE_M] = cn_bf16_from_float(m.data[i]);
        at[CN_STATE_V] = cn_bf16_from_float(v.data[i]);
    }
    guarded_free(&p), guarded_free(&m), guarded_free(&v);
    return r;
}

static float rig_value(const adam_rig *r, size_t i)
{
    return cn_float_join(((uint16_t *)(void *)r->table.data)[i], *cn_state_at((uint16_t *)(void *)r->state.data, i));
}

static void test_adam_table(void **state)
{
    (void)state;
    const cn_adam adam = { .rate = 0.01f, .beta1 = 0.9f, .beta2 = 0.99f, .epsilon = 1e-15f, .dither = 0x4321 };
    static const size_t sizes[] = { 8, 8, 16, 24, 1024, 1032, 1032 };
    for (size_t c = 0; c < sizeof sizes / sizeof *sizes; c++) {
        adam_rig a = make_adam_rig(sizes[c]), b = make_adam_rig(sizes[c]), before = make_adam_rig(sizes[c]);
        cn_kernel_ref.adam_table(&adam, (uint16_t *)(void *)a.table.data, (uint16_t *)(void *)a.state.data, a.grad.data,
                                 NULL, a.n);
        /* With a list of what was touched, and without. */
        uint8_t touched[1032 / (2 * CN_TOUCH) + 1];
        for (size_t i = 0; i < sizeof touched; i++)
            touched[i] = i != 4; /* the block whose gradients are all 0 */
        set->adam_table(&adam, (uint16_t *)(void *)b.table.data, (uint16_t *)(void *)b.state.data, b.grad.data,
                        c & 1 ? touched : NULL, b.n);
        for (size_t i = 0; (c & 1) && i < (b.n + 2 * CN_TOUCH - 1) / (2 * CN_TOUCH); i++)
            assert_int_equal(touched[i], 0);
        for (size_t i = 0; i < a.n; i++) {
            const float want = rig_value(&a, i), got = rig_value(&b, i), old = rig_value(&before, i);
            assert_true(fabsf(got - want) <= 1e-6f + 1e-5f * fabsf(want));
            assert_true((before.grad.data[i] == 0) == (got == old));
            assert_true(b.grad.data[i] == 0);
            for (int k = CN_STATE_M; k <= CN_STATE_V; k += CN_STATE_V - CN_STATE_M) {
                const int x = cn_state_at((uint16_t *)(void *)a.state.data, i)[k],
                          y = cn_state_at((uint16_t *)(void *)b.state.data, i)[k];
                assert_true(abs(x - y) <= 1); /* a cut may fall to either side */
            }
        }
        adam_rig *all[] = { &a, &b, &before };
        for (int i = 0; i < 3; i++)
            guarded_free(&all[i]->table), guarded_free(&all[i]->state), guarded_free(&all[i]->grad);
    }
    runs++;
}

/* Odd numbers of samples and inputs. A sample has the same bits by itself as among others. */
static void test_tiny(void **state)
{
    (void)state;
    for (uint32_t n = 1; n <= 21; n += 4)
        for (uint32_t k = 4; k <= CN_TINY; k += 14) {
            const cn_level weights = { .resolution = 1, .entries = k * CN_TINY_PAIRS };
            guarded w = random_table(&weights), x = guarded_floats((size_t)n * CN_TINY),
                    dy = guarded_floats((size_t)n * CN_TINY), y = guarded_floats((size_t)n * CN_TINY),
                    want = guarded_floats((size_t)n * CN_TINY), grad = guarded_floats((size_t)k * CN_TINY),
                    grad_want = guarded_floats((size_t)k * CN_TINY);
            const cn_tiny_layer of = { (const uint32_t *)(const void *)w.data, k };
            fill_random(x.data, (size_t)n * CN_TINY, -1, 1, 40);
            fill_random(dy.data, (size_t)n * CN_TINY, -1, 1, 41);
            fill_random(grad.data, (size_t)k * CN_TINY, -1, 1, 42);
            memcpy(grad_want.data, grad.data, sizeof(float) * k * CN_TINY);
            for (int relu = 0; relu < 2; relu++) {
                float alone[CN_TINY];
                cn_kernel_ref.tiny(of, x.data, n, relu, want.data);
                set->tiny(of, x.data, n, relu, y.data);
                assert_close(y.data, want.data, (size_t)n * CN_TINY, 1e-5f, 1e-5f);
                set->tiny(of, x.data + (size_t)(n - 1) * CN_TINY, 1, relu, alone);
                assert_memory_equal(alone, y.data + (size_t)(n - 1) * CN_TINY, sizeof alone);
            }
            for (int gated = 0; gated < 2; gated++) {
                memset(y.data, 0, sizeof(float) * n * CN_TINY);
                memset(want.data, 0, sizeof(float) * n * CN_TINY);
                cn_kernel_ref.tiny_backward(of, dy.data, n, gated ? x.data : NULL, want.data);
                set->tiny_backward(of, dy.data, n, gated ? x.data : NULL, y.data);
                assert_close(y.data, want.data, (size_t)n * CN_TINY, 1e-5f, 1e-5f);
            }
            cn_kernel_ref.tiny_gradient(k, x.data, dy.data, n, grad_want.data);
            set->tiny_gradient(k, x.data, dy.data, n, grad.data);
            assert_close(grad.data, grad_want.data, (size_t)k * CN_TINY, 1e-5f, 1e-5f);
            guarded_free(&w), guarded_free(&x), guarded_free(&dy), guarded_free(&y), guarded_free(&want);
            guarded_free(&grad), guarded_free(&grad_want);
        }
    runs++;
}

static void test_float_halves(void **state)
{
    (void)state;
    float x[1000];
    fill_random(x, 1000, -4, 4, 30);
    for (int i = 0; i < 1000; i++) {
        uint16_t high, low;
        cn_float_split(x[i], &high, &low);
        assert_true(cn_float_join(high, low) == x[i]);
        assert_true(fabsf(cn_bf16_to_float(high) - x[i]) <= fabsf(x[i]) / 256);
    }
}

static int print_count(void **state)
{
    (void)state;
    printf("kernels run on %s: %d\n", set->name, runs);
    return 0;
}

/* The named set, or NULL where this machine lacks it. */
static const cn_kernel *find_set(const char *name)
{
    const cn_kernel *sets[4];
    const int n = cn_kernel_sets(sets);
    for (int i = 0; i < n; i++)
        if (strcmp(sets[i]->name, name) == 0) return sets[i];
#ifdef CN_EMULATED
    static cn_kernel emulated;
    emulated = cn_kernel_ref;
    if (strcmp(name, "emulated") == 0 && emulated_fill(&emulated)) return &emulated;
#endif
    return NULL;
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_gemm),
        cmocka_unit_test(test_weight_grad),
        cmocka_unit_test(test_encode),
        cmocka_unit_test(test_encode_backward),
        cmocka_unit_test(test_march_and_place),
        cmocka_unit_test(test_window_sums),
        cmocka_unit_test(test_match),
        cmocka_unit_test(test_match_finds_the_two_largest),
        cmocka_unit_test(test_march_keeps_its_limits),
        cmocka_unit_test(test_adam),
        cmocka_unit_test(test_adam_table),
        cmocka_unit_test(test_tiny),
        cmocka_unit_test(test_float_halves),
    };
    const char *name = argc > 1 ? argv[1] : "ref";
    set = find_set(name);
    if (!set) {
        printf("skipped: this processor has no %s; kernels run on %s: 0\n", name, name);
        return 77;
    }
    return cmocka_run_group_tests(tests, NULL, print_count);
}
