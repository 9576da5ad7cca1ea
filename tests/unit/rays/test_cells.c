/* Which cells of a tile may hold matter. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "field/occupancy.h"
#include "rays/rays.h"

#include <math.h>
#include <stdlib.h>

static const cn_box box = { { 0, 0, 0 }, { 10, 10, 10 }, 0.1f, 100, 0.01f };

/* A camera at (0, -10, 0) that looks north or south, level. */
static cn_ray_generator looking(double north)
{
    const cn_camera camera = { .lens = CN_LENS_PINHOLE, .width = 40, .height = 40, .params = { 40, 40, 20, 20 } };
    const cn_view view = { .rotation = { north, 0, 0, 0, 0, -1, 0, north, 0 }, .translation = { 0, 0, 10 * north } };
    cn_ray_generator generator;
    cn_ray_generator_init(&generator, &camera, &view, &box);
    return generator;
}

/* Usable cells, and those of them nearer than `near` to the first camera. */
static uint32_t usable_cells(uint32_t n, const float *alone_from_m, double near, uint32_t *n_near)
{
    const cn_ray_generator generators[2] = { looking(1), looking(-1) };
    uint8_t *usable = malloc(CN_OCC_CELLS);
    assert_non_null(usable);
    const cn_seeing_views views = { n, generators, alone_from_m };
    cn_rays_visible_cells(NULL, &box, &views, usable);
    uint32_t count = 0;
    *n_near = 0;
    for (uint32_t i = 0; i < CN_OCC_CELLS; i++) {
        float x[3];
        cn_occupancy_centre(i, x);
        const double y = 10 * (double)x[1] + 10;
        count += usable[i];
        *n_near +=
            usable[i] && sqrt(100 * (double)x[0] * (double)x[0] + y * y + 100 * (double)x[2] * (double)x[2]) < near;
    }
    free(usable);
    return count;
}

static void test_one_view_from_its_distance_on(void **state)
{
    (void)state;
    uint32_t near;
    const float never[2] = { INFINITY, INFINITY }, from_8[2] = { 8, INFINITY };
    /* A single view makes every cell usable that it sees. */
    const uint32_t alone = usable_cells(1, never, 7.9, &near);
    assert_true(alone > 0 && near > 0);
    /* Two views that see different places do not support each other. */
    assert_int_equal(usable_cells(2, never, 7.9, &near), 0);
    /* Beyond 8 m, the first view needs no second one. */
    const uint32_t far = usable_cells(2, from_8, 7.9, &near);
    assert_int_equal(near, 0);
    assert_true(far > alone / 2 && far < alone);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_one_view_from_its_distance_on) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
