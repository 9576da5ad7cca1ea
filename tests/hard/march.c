/* Extreme rays: marching, contraction and placing with every instruction set of this machine, and the ranges that a
 * tile may have. */
#include "hard.h"

#include "base/json.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const cn_kernel *sets[4];
static int n_sets;
static uint32_t full[CN_OCC_CELLS / 32];

enum { ROOM = 40000 };
static float at[ROOM + 1];

static uint32_t march(const cn_kernel *k, const cn_box_ray *ray, float near_t, float far_t, double step, float jitter)
{
    const cn_march m = { near_t, far_t, (float)(1 + step), jitter };
    at[ROOM] = -1;
    hard_traps_on();
    const uint32_t n = k->march(ray, &m, full, at, ROOM);
    hard_traps_off();
    assert_true(at[ROOM] == -1 && n <= ROOM);
    return n;
}

static const cn_box_ray slanting = { { 0.1f, -0.2f, 0.3f }, { 0.1f, 0.07f, -0.13f } };

/* Steps of 1e-5 of the distance, the smallest that a tile may have: each farther than the one before, none left out,
 * and after thirty thousand of them still where a double says. Guard: t is a product, of 16 powers at most at a time,
 * so rounding stays relative (kernel_ref.c, kernel_simd.h); with sums of 1e-5 * near in its place the last is off by a
 * sixth. */
static void test_tiny_steps(void **state)
{
    (void)state;
    for (int s = 0; s < n_sets; s++) {
        const float ratio = (float)(1 + 1.1e-5);
        const uint32_t n = march(sets[s], &slanting, 1, 1.39f, 1.1e-5, 0.5f);
        const double want = log(1.39) / log((double)ratio);
        double worst = 0;
        assert_true(fabs(n - want) < 0.002 * want);
        for (uint32_t i = 0; i < n; i++) {
            assert_true(i == 0 || at[i] > at[i - 1]);
            worst = fmax(worst, fabs((double)at[i] / pow((double)ratio, i + 0.5) - 1));
        }
        print_message("%s: %u steps, off by %.2g of the distance\n", sets[s]->name, n, worst);
        assert_true(worst < 2e-4);
    }
}

/* near equal to far: no sample; a last place apart: one at most; near beyond far: none.
 * Guard: the mask of lanes that lie before far in kernel_simd.h; without it a vector's worth of samples comes from
 * beyond. */
static void test_near_is_far(void **state)
{
    (void)state;
    for (int s = 0; s < n_sets; s++) {
        for (float near_t = 1e-3f; near_t < 1e6f; near_t *= 7.3f) {
            assert_int_equal(march(sets[s], &slanting, near_t, near_t, 1e-3, 0), 0);
            assert_int_equal(march(sets[s], &slanting, near_t, nextafterf(near_t, INFINITY), 1e-3, 0), 1);
            assert_true(at[0] == near_t);
            assert_int_equal(march(sets[s], &slanting, near_t, nextafterf(near_t, INFINITY), 1e-3, 0.5f), 0);
            assert_int_equal(march(sets[s], &slanting, near_t, 0.5f * near_t, 1e-3, 0), 0);
        }
    }
}

static void place_double(const cn_box_ray *ray, double t, double u[3], double *scale)
{
    double x[3], m = 0;
    for (int a = 0; a < 3; a++) {
        x[a] = (double)ray->origin[a] + t * (double)ray->dir[a];
        m = fmax(m, fabs(x[a]));
    }
    *scale = m > 1 ? (2 - 1 / m) / m : 1;
    for (int a = 0; a < 3; a++)
        u[a] = x[a] * *scale / 4 + 0.5;
}

/* Marches and places a ray. Every sample is in the unit cube, where doubles put it too, and has a length. */
static void follow(const cn_kernel *k, const cn_box_ray *ray)
{
    enum { MOST = 2160 };
    static float pos[(MOST / CN_PANEL + 1) * 3 * CN_PANEL], length[MOST];
    const float step = 1.0f / 128;
    const uint32_t n = march(k, ray, 1e-3f, 1e4f, (double)step, 0.5f);
    assert_true(n > 2000 && n < MOST);
    hard_traps_on();
    k->place(ray, at, n, (cn_spacing){ step, 0.25f }, (cn_lanes){ pos, 0 }, length);
    hard_traps_off();
    for (uint32_t i = 0; i < n; i++) {
        double u[3], scale;
        place_double(ray, (double)at[i], u, &scale);
        const double want = (double)step * (double)at[i] * 0.25 * scale;
        for (uint32_t a = 0; a < 3; a++) {
            const float got = pos[i / CN_PANEL * 3 * CN_PANEL + a * CN_PANEL + i % CN_PANEL];
            assert_true(got >= 0 && got <= 1 && fabs((double)got - u[a]) < 3e-7);
        }
        assert_true(length[i] > 0 && fabs((double)length[i] - want) < 4e-6 * want);
    }
}

/* Along a face and in it, along an edge and through it, through a corner, from inside, and from the very centre, where
 * the norm is 0. Guard: the norm is at least 1 where it is divided by (`m > 1` in kernel_ref.c, v_max(m, one) in
 * kernel_simd.h); without it what lies inside is folded too, and the centre is 0 / 0. */
static void test_faces_and_edges(void **state)
{
    (void)state;
    static const cn_box_ray rays[] = {
        { { 0, 1, 0 }, { 1, 0, 0 } },                         /* in a face */
        { { -3, 0.5f, 1 }, { 1, 0, 0 } },                     /* in a face, from outside */
        { { -3, 1, 1 }, { 1, 0, -0.0f } },                    /* along an edge */
        { { -1, 2, 0 }, { 1, -1, 0 } },                       /* through an edge */
        { { -1, -1, -1 }, { 0.57735f, 0.57735f, 0.57735f } }, /* corner to corner, through the centre */
        { { 2, 2, 2 }, { -0.57735f, -0.57735f, -0.57735f } },
        { { 0, 0, 0 }, { 0, 0, 1 } }, /* from the centre */
        { { 0, 0, 0 }, { 1e-20f, 1e-30f, 1 } },
        { { 1, 1, 1 }, { 0, 0, -1 } },          /* from a corner along an edge */
        { { 0.99999994f, 0, 0 }, { 0, 1, 0 } }, /* beside a face */
        { { 1.0000001f, 0, 0 }, { 0, 1, 0 } },
        { { 1e4f, 1e4f, -1e4f }, { -0.7f, -0.7f, 0.1f } }, /* from far away */
    };
    for (int s = 0; s < n_sets; s++)
        for (size_t r = 0; r < sizeof rays / sizeof *rays; r++)
            follow(sets[s], &rays[r]);
    /* The centre itself. */
    static const cn_box_ray still = { { 0, 0, 0 }, { 0, 0, 0 } };
    for (int s = 0; s < n_sets; s++) {
        float pos[3 * CN_PANEL], length;
        const float t = 1;
        hard_traps_on();
        sets[s]->place(&still, &t, 1, (cn_spacing){ 0.01f, 1 }, (cn_lanes){ pos, 0 }, &length);
        hard_traps_off();
        for (int a = 0; a < 3; a++)
            assert_true(pos[a * CN_PANEL] == 0.5f);
        assert_true(length == 0.01f);
    }
}

/* A ray that is not a number reads no cell outside the grid and makes no position outside the table.
 * Guard: cells and positions are compared so that NaN falls to the border (axis_cell, and `c > 0 ?` of the march, in
 * kernel_ref.c; max before min in kernel_simd.h). Without it the table is read at a place that no one chose (a crash,
 * under the sanitizers for certain). */
static void test_not_a_number(void **state)
{
    (void)state;
    static const cn_box_ray rays[] = { { { NAN, 0, 0 }, { 0, 0, 1 } },
                                       { { 0, 0, 0 }, { NAN, NAN, NAN } },
                                       { { INFINITY, 0, 0 }, { -INFINITY, 0, 1 } } };
    static const cn_level level = { .resolution = 30, .entries = 32 * 32 * 32 };
    uint32_t *table = malloc(level.entries * sizeof *table); /* of exactly this size, for the sanitizers */
    assert_non_null(table);
    for (uint32_t i = 0; i < level.entries; i++)
        table[i] = 0x3f803f80;
    for (int s = 0; s < n_sets; s++)
        for (size_t r = 0; r < sizeof rays / sizeof *rays; r++) {
            const cn_march m = { 1, 2, 1.01f, 0 };
            float pos[3 * CN_PANEL] = { 0 }, length[CN_PANEL], out[2 * CN_PANEL];
            const uint32_t n = sets[s]->march(&rays[r], &m, full, at, CN_PANEL);
            assert_true(n <= CN_PANEL);
            sets[s]->place(&rays[r], at, n, (cn_spacing){ 0.01f, 1 }, (cn_lanes){ pos, 0 }, length);
            sets[s]->encode(&level, table, pos, 1, out, 2 * CN_PANEL);
            for (int i = 0; i < 2 * CN_PANEL; i++)
                assert_true(fabsf(out[i] - 1) < 1e-5f);
        }
    free(table);
}

static void expect_refusal(synthetic_scene *synthetic, const cn_train_options *o, cn_status want, const char *what)
{
    const cn_context ctx = { 0 };
    const cn_train_input input = { &synthetic->scene, &synthetic->index, synthetic->pixels, &synthetic->tile };
    char dir[96];
    cn_train_result result;
    snprintf(dir, sizeof dir, "%s/refused", synthetic->folder);
    alarm(20); /* a march that is not refused may never end */
    assert_int_equal(cn_train_tile(&ctx, &input, o, "parent", dir, &result), want);
    alarm(0);
    assert_non_null(strstr(cn_error_message(), what));
}

/* Steps that float cannot add to 1 would never arrive, nor would a march from 0: training refuses them, and so does a
 * tile on disk. Guards: check_march in train/trainer.c, and read_box in tile/tile.c. Without the first a march from 0
 * does not end (the alarm was seen). Without the second a render of such a tile would not end. */
static void test_ranges_are_refused(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    hard_scene_init(&synthetic, 2);
    cn_train_options o = hard_options();
    static const double ranges[][2] = { { 0, 10 }, { 5, 5 }, { 5, 4 }, { 1, INFINITY }, { -1, 10 } };
    for (size_t i = 0; i < sizeof ranges / sizeof *ranges; i++) {
        synthetic.tile.near_m = ranges[i][0];
        synthetic.tile.far_m = ranges[i][1];
        expect_refusal(&synthetic, &o, CN_ERR_DATA, "conurb plan");
    }
    synthetic.tile.near_m = 1;
    synthetic.tile.far_m = 30;
    o.march_step = 1e-9;
    expect_refusal(&synthetic, &o, CN_ERR_CONFIG, "march_step");
    /* Neighbouring floats are a valid range, but no sample is in it. */
    o = hard_options();
    o.steps = 24;
    synthetic.tile.near_m = 5;
    synthetic.tile.far_m = (double)nextafterf(5, 6);
    hard_train(&synthetic, &o);
    synthetic_scene_deinit(&synthetic);
}

static void test_tile_refuses(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    hard_run run;
    hard_scene_init(&synthetic, 2);
    const cn_train_options o = hard_options();
    hard_run_init(&run, &synthetic, &o, NULL);
    static const float bad[][3] = { { 1, 30, 1e-8f }, { 0, 30, 0.01f }, { 3, 3, 0.01f }, { 3, 2, 0.01f } };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char path[96];
        cn_tile *tile = NULL;
        run.t.box.near_m = bad[i][0];
        run.t.box.far_m = bad[i][1];
        run.t.box.step = bad[i][2];
        run.t.sampler.pace.march_step = (double)bad[i][2];
        snprintf(path, sizeof path, "%s/bad.safetensors", synthetic.folder);
        hard_must(cn_trainer_save_tile(&run.t, "parent", path));
        assert_int_equal(cn_tile_open(&tile, path), CN_ERR_FORMAT);
        assert_null(tile);
    }
    hard_run_deinit(&run);
    synthetic_scene_deinit(&synthetic);
}

int main(void)
{
    n_sets = cn_kernel_sets(sets);
    memset(full, 0xff, sizeof full);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_tiny_steps),         cmocka_unit_test(test_near_is_far),
        cmocka_unit_test(test_faces_and_edges),    cmocka_unit_test(test_not_a_number),
        cmocka_unit_test(test_ranges_are_refused), cmocka_unit_test(test_tile_refuses),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
