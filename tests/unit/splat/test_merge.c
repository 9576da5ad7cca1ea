/* Fewer Gaussians for many: a wall stays closed, and has its colours, from afar. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "splat/merge.h"

#include <math.h>
#include <stdlib.h>

enum { SIDE = 150, N = SIDE * SIDE, MOST = 600, WIDTH = 64 };
#define WALL_M 30.0

static const cn_camera camera = {
    .lens = CN_LENS_PINHOLE, .width = WIDTH, .height = WIDTH, .params = { 128, 128, 32, 32 }
};
/* 40 m before the wall: it shows 20 of its 30 m. */
static const cn_view view = { .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 }, .translation = { 0, 0, 40 } };
static cn_context ctx;

/* A wall at right angles to z, of flat Gaussians that just close it; red grows along x. */
static cn_splats *make_wall(void)
{
    cn_splats *s;
    assert_int_equal(cn_splats_create(&s, N, 0), CN_OK);
    for (int i = 0; i < N; i++) {
        const int x = i % SIDE, y = i / SIDE;
        s->centre[i][0] = (float)(WALL_M * ((x + 0.5) / SIDE - 0.5));
        s->centre[i][1] = (float)(WALL_M * ((y + 0.5) / SIDE - 0.5));
        for (int k = 0; k < 3; k++)
            s->scale[i][k] = (float)(WALL_M / SIDE * (k == 2 ? 0.02 : 0.6));
        s->rotation[i][0] = 1;
        s->opacity[i] = 0.95f;
        for (int k = 0; k < 3; k++)
            s->colour[3 * i + k] = k ? 0 : (float)x / SIDE - 0.5f;
    }
    return s;
}

static uint32_t *all_of(size_t n)
{
    uint32_t *which = malloc(n * sizeof *which);
    assert_non_null(which);
    for (size_t i = 0; i < n; i++)
        which[i] = (uint32_t)i;
    return which;
}

static void draw(const cn_splats *s, float *rgb)
{
    assert_int_equal(cn_splats_render(&ctx, s, &camera, &view, rgb), CN_OK);
}

static void a_wall_stays_closed(void **state)
{
    static float before[WIDTH * WIDTH * 3], after[WIDTH * WIDTH * 3];
    (void)state;
    cn_splats *wall = make_wall(), *few;
    uint32_t *which = all_of(N);
    double cell_m, worst = 0, sum = 0;
    assert_int_equal(cn_splats_merge(wall, which, N, MOST, &few, &cell_m), CN_OK);
    assert_true(few->n <= MOST && few->n > MOST / 3);
    assert_true(cell_m > WALL_M / SIDE && cell_m < 3);
    draw(wall, before);
    draw(few, after);
    for (int i = 0; i < WIDTH * WIDTH * 3; i++) {
        const double off = fabs((double)(after[i] - before[i]));
        worst = fmax(worst, off);
        sum += off * off;
    }
    if (!(worst < 0.15)) fail_msg("a pixel is %g off", worst);
    if (!(sqrt(sum / (WIDTH * WIDTH * 3)) < 0.05)) fail_msg("%g rms off", sqrt(sum / (WIDTH * WIDTH * 3)));
    for (size_t i = 0; i < few->n; i++) /* flat as the wall is */
        assert_true(few->scale[i][0] < 0.01f && few->scale[i][1] > 0.1f);
    cn_splats_destroy(&few);
    cn_splats_destroy(&wall);
    free(which);
}

static void one_stays_what_it_is(void **state)
{
    (void)state;
    cn_splats *wall = make_wall(), *one;
    double cell_m;
    wall->scale[7][0] = 0.3f;
    wall->scale[7][1] = 0.5f;
    assert_int_equal(cn_splats_merge(wall, (const uint32_t[]){ 7 }, 1, 1, &one, &cell_m), CN_OK);
    assert_int_equal(one->n, 1);
    for (int k = 0; k < 3; k++) {
        assert_true(fabsf(one->centre[0][k] - wall->centre[7][k]) < 1e-5f);
        assert_true(fabsf(one->colour[k] - wall->colour[21 + k]) < 1e-6f);
    }
    assert_true(fabsf(one->scale[0][0] - wall->scale[7][2]) < 1e-5f); /* ascending */
    assert_true(fabsf(one->scale[0][1] - 0.3f) < 1e-5f && fabsf(one->scale[0][2] - 0.5f) < 1e-5f);
    assert_true(fabsf(one->opacity[0] - wall->opacity[7]) < 1e-5f);
    cn_splats_destroy(&one);
    cn_splats_destroy(&wall);
}

/* From two opposite corners, on both sides of the origin. */
static void all_become_one(void **state)
{
    (void)state;
    cn_splats *wall = make_wall(), *one;
    double cell_m;
    assert_int_equal(cn_splats_merge(wall, (const uint32_t[]){ 0, N - 1 }, 2, 1, &one, &cell_m), CN_OK);
    assert_int_equal(one->n, 1);
    for (int k = 0; k < 3; k++)
        assert_true(fabsf(one->centre[0][k]) < 1e-4f);
    assert_true(fabsf(one->scale[0][2] - sqrtf(2) * wall->centre[N - 1][0]) < 0.1f);
    cn_splats_destroy(&one);
    cn_splats_destroy(&wall);
}

/* Two thin ones share a cube: together they cover as much as before. */
static void what_is_thin_stays_thin(void **state)
{
    (void)state;
    cn_splats *wall = make_wall(), *one;
    double cell_m;
    wall->opacity[0] = wall->opacity[1] = 0.1f;
    assert_int_equal(cn_splats_merge(wall, (const uint32_t[]){ 0, 1 }, 2, 1, &one, &cell_m), CN_OK);
    const float area = one->scale[0][1] * one->scale[0][2], each = wall->scale[0][0] * wall->scale[0][1];
    assert_true(fabsf(one->opacity[0] * area - 2 * 0.1f * each) < 1e-5f);
    cn_splats_destroy(&one);
    cn_splats_destroy(&wall);
}

static int begin(void **state)
{
    (void)state;
    return cn_pool_create(&ctx.pool, 1) == CN_OK ? 0 : -1;
}

static int end(void **state)
{
    (void)state;
    cn_pool_destroy(&ctx.pool);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(a_wall_stays_closed), cmocka_unit_test(one_stays_what_it_is),
                                        cmocka_unit_test(all_become_one), cmocka_unit_test(what_is_thin_stays_thin) };
    return cmocka_run_group_tests(tests, begin, end);
}
