/* The rasteriser of splats: gradients against finite differences, each instruction set against the reference, the same
 * bits on any number of threads. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/rng.h"
#include "splat/raster.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 59, HEIGHT = 44, MANY = 3000, FEW = 9 };

static const cn_camera camera = {
    .lens = CN_LENS_PINHOLE, .width = WIDTH, .height = HEIGHT, .params = { 48, 50, 30, 21 }
};
/* Turned by 0.3 about the vertical axis. */
static const cn_view view = { .rotation = { 0.9553365, 0, -0.2955202, 0, 1, 0, 0.2955202, 0, 0.9553365 },
                              .translation = { 0.1, -0.2, 0.3 } };
static const double origin[3] = { 1, 2, 0.5 };

static float between(float low, float high, uint64_t stream, uint64_t at)
{
    return low + (high - low) * cn_rng_float(3, stream, at);
}

/* Rows of splats before the camera; some of them too near, or beside the picture. */
static float *make(size_t n, uint32_t degree, float size)
{
    const uint32_t length = cn_row_length(degree);
    float *rows = calloc(n, length * sizeof *rows);
    assert_non_null(rows);
    for (size_t i = 0; i < n; i++) {
        float *row = rows + i * length;
        const float z = between(2, 6, 1, i), u = between(-0.9f, 0.9f, 2, i), v = between(-0.7f, 0.7f, 3, i);
        row[0] = z * (u + 0.31f) - 1;
        row[1] = z * v - 2;
        row[2] = z - 0.5f;
        for (size_t k = 0; k < 3; k++)
            row[CN_ROW_SCALE + k] = logf(size) + between(-1, 0.7f, 4, 3 * i + k);
        for (size_t k = 0; k < 4; k++)
            row[CN_ROW_ROTATION + k] = between(-1, 1, 5, 4 * i + k);
        row[CN_ROW_OPACITY] = between(-2, 3, 6, i);
        for (size_t k = CN_ROW_COLOUR; k < length; k++)
            row[k] = between(-0.5f, 1, 7, 64 * i + k) * (k < CN_ROW_COLOUR + 3 ? 1 : 0.3f);
    }
    return rows;
}

static uint8_t *make_target(void)
{
    const size_t n = cn_raster_target_size(WIDTH, HEIGHT);
    uint8_t *target = malloc(n);
    assert_non_null(target);
    for (size_t i = 0; i < n; i++)
        target[i] = (uint8_t)(cn_rng_u64(1, 1, i / 5) & 255);
    return target;
}

static double loss_of(cn_raster *r, const cn_splat_camera *cam, const cn_splat_rows *rows, const uint8_t *target)
{
    static float rgb[WIDTH * HEIGHT * 3], light[WIDTH * HEIGHT];
    double sum = 0;
    assert_int_equal(cn_raster_bin(r, cam, rows), CN_OK);
    cn_raster_draw(r, cam, rgb, light);
    for (uint32_t y = 0; y < HEIGHT; y++)
        for (uint32_t x = 0; x < WIDTH; x++) {
            const uint8_t *at = target + (y / 16 * r->tiles_x + x / 16) * (size_t)(4 * CN_SPLAT_TILE_PIXELS);
            const size_t in = y % 16 * 16 + x % 16, p = y * (size_t)WIDTH + x;
            for (size_t k = 0; k < 4; k++) {
                const double wanted = at[k * CN_SPLAT_TILE_PIXELS + in] / 255.0;
                const double off = k < 3 ? (double)rgb[3 * p + k] - wanted : (double)light[p] - (1 - wanted);
                sum += 0.5 * off * off;
            }
        }
    return sum;
}

/* The gradients of one group of parameters, by both ways, over all splats. */
static void check_group(const double (*both)[2], size_t n, uint32_t length, const uint32_t group[2])
{
    double off = 0, size = 0;
    for (size_t i = 0; i < n; i++)
        for (uint32_t k = group[0]; k < group[1]; k++) {
            const double *b = both[i * length + k];
            off += (b[0] - b[1]) * (b[0] - b[1]);
            size += b[0] * b[0];
        }
    if (!(sqrt(off) < 5e-4 * sqrt(size)))
        fail_msg("parameters %u to %u: gradients of norm %g are off by %g", group[0], group[1], sqrt(size), sqrt(off));
}

static void check_gradients(uint32_t degree)
{
    const uint32_t length = cn_row_length(degree);
    cn_splat_camera cam = cn_splat_camera_of(&camera, &view, origin, 0.2f);
    cam.least_alpha = 1e-7f; /* a Gaussian that is cut off makes the loss jump */
    float *rows = make(FEW, degree, 0.4f);
    uint8_t *target = make_target();
    double(*both)[2] = calloc((size_t)FEW * length, sizeof *both);
    cn_raster r;
    assert_non_null(both);
    assert_int_equal(cn_raster_init(&r, NULL, &cn_splat_kernel_ref, FEW), CN_OK);
    const cn_splat_rows all = { rows, FEW, degree };
    assert_int_equal(cn_raster_bin(&r, &cam, &all), CN_OK);
    cn_raster_step(&r, &cam, target);
    assert_true(r.n_visible > FEW / 2);
    for (uint32_t i = 0; i < r.n_visible; i++) {
        float sums[CN_SPLAT_SUMS], gradient[CN_ROW_MOST];
        const uint32_t s = r.visible[i];
        cn_raster_sums(&r, s, sums);
        cn_splat_project_back(&cam, rows + s * length, degree, &r.flats[s], sums, gradient);
        for (uint32_t k = 0; k < length; k++)
            both[s * length + k][0] = (double)gradient[k];
    }
    for (size_t k = 0; k < (size_t)FEW * length; k++) {
        const float step = 4e-3f, at = rows[k];
        rows[k] = at + step;
        const double after = loss_of(&r, &cam, &all, target);
        rows[k] = at - step;
        both[k][1] = (after - loss_of(&r, &cam, &all, target)) / (2 * (double)step);
        rows[k] = at;
    }
    const uint32_t groups[][2] = { { 0, 3 }, { 3, 6 }, { 6, 10 }, { 10, 11 }, { 11, length } };
    for (size_t g = 0; g < 5; g++)
        check_group((const double(*)[2])both, FEW, length, groups[g]);
    cn_raster_deinit(&r);
    free(rows);
    free(target);
    free(both);
}

static void test_gradients(void **state)
{
    (void)state;
    for (uint32_t degree = 0; degree <= 2; degree += 2)
        check_gradients(degree);
}

/* What a step leaves, on one kernel and number of threads. */
typedef struct outcome {
    float rgb[WIDTH * HEIGHT * 3], sums[MANY][CN_SPLAT_SUMS];
    double loss;
} outcome;

static outcome *run(const cn_splat_kernel *kernel, unsigned threads)
{
    const cn_splat_camera cam = cn_splat_camera_of(&camera, &view, origin, 0.2f);
    float *rows = make(MANY, 1, 0.12f);
    uint8_t *target = make_target();
    const cn_splat_rows all = { rows, MANY, 1 };
    cn_pool *pool;
    cn_raster r;
    outcome *o = calloc(1, sizeof *o);
    assert_non_null(o);
    assert_int_equal(cn_pool_create(&pool, threads), CN_OK);
    assert_int_equal(cn_raster_init(&r, pool, kernel, MANY), CN_OK);
    assert_int_equal(cn_raster_bin(&r, &cam, &all), CN_OK);
    cn_raster_draw(&r, &cam, o->rgb, NULL);
    o->loss = cn_raster_step(&r, &cam, target);
    for (uint32_t i = 0; i < r.n_visible; i++)
        cn_raster_sums(&r, r.visible[i], o->sums[r.visible[i]]);
    cn_raster_deinit(&r);
    cn_pool_destroy(&pool);
    free(rows);
    free(target);
    return o;
}

static void test_sets(void **state)
{
    (void)state;
    const cn_splat_kernel *sets[3];
    const int n_sets = cn_splat_kernels(sets);
    outcome *plain = run(sets[0], 1);
    for (int s = 1; s < n_sets; s++) {
        outcome *wide = run(sets[s], 1);
        double gap[CN_SPLAT_SUMS] = { 0 }, size[CN_SPLAT_SUMS] = { 0 };
        for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++)
            assert_true(fabsf(plain->rgb[i] - wide->rgb[i]) < 0.005f); /* one Gaussian at the least alpha */
        assert_true(fabs(plain->loss - wide->loss) < 1e-4 * plain->loss);
        for (size_t i = 0; i < MANY; i++)
            for (size_t k = 0; k < CN_SPLAT_SUMS; k++) {
                const double a = (double)plain->sums[i][k], b = (double)wide->sums[i][k];
                gap[k] += (a - b) * (a - b);
                size[k] += a * a;
            }
        for (size_t k = 0; k < CN_SPLAT_SUMS; k++)
            if (!(sqrt(gap[k]) <= 2e-3 * sqrt(size[k]) && size[k] > 0))
                fail_msg("%s: sum %zu is off by %g of %g", sets[s]->name, k, sqrt(gap[k]), sqrt(size[k]));
        free(wide);
    }
    free(plain);
    if (n_sets == 1) skip();
}

static void test_threads(void **state)
{
    (void)state;
    outcome *one = run(cn_splat_kernel_best(), 1);
    for (unsigned threads = 2; threads <= 5; threads += 3) {
        outcome *more = run(cn_splat_kernel_best(), threads);
        assert_memory_equal(one, more, sizeof *one);
        free(more);
    }
    free(one);
}

/* Pictures that can be told: nothing, and one opaque splat before another. */
static void test_order(void **state)
{
    (void)state;
    static float rgb[WIDTH * HEIGHT * 3], light[WIDTH * HEIGHT];
    static const cn_view straight = { .rotation = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } };
    const cn_splat_camera cam = cn_splat_camera_of(&camera, &straight, (const double[3]){ 0 }, 0.2f);
    const float big = logf(1), full = 20, c = 0.5f / 0.28209479f;
    const float rows[2][14] = { { 0, 0, 5, big, big, big, 1, 0, 0, 0, full, c, -c, -c },   /* red, behind */
                                { 0, 0, 3, big, big, big, 1, 0, 0, 0, full, -c, c, -c } }; /* green */
    const size_t middle = 21 * WIDTH + 30;
    cn_raster r;
    assert_int_equal(cn_raster_init(&r, NULL, cn_splat_kernel_best(), 2), CN_OK);
    const cn_splat_rows none = { rows[0], 0, 0 }, both = { rows[0], 2, 0 };
    assert_int_equal(cn_raster_bin(&r, &cam, &none), CN_OK);
    cn_raster_draw(&r, &cam, rgb, light);
    assert_true(light[0] == 1 && rgb[0] == 0 && light[WIDTH * HEIGHT - 1] == 1);
    assert_int_equal(cn_raster_bin(&r, &cam, &both), CN_OK);
    cn_raster_draw(&r, &cam, rgb, light);
    assert_true(fabsf(rgb[3 * middle + 1] - 0.99f) < 2e-3f && fabsf(rgb[3 * middle] - 0.0099f) < 2e-3f);
    assert_true(light[middle] < 1e-3f);
    cn_raster_deinit(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_gradients), cmocka_unit_test(test_sets),
                                        cmocka_unit_test(test_threads), cmocka_unit_test(test_order) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
