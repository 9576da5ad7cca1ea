/* What stands before a camera, nearer than its rays begin, and what does not: behind it, beside it, farther away. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "splat/clear.h"

#include <string.h>

enum { N = 40 };
#define NEAR 3.0

static cn_view views[N];
static cn_camera camera = { .lens = CN_LENS_PINHOLE, .width = 100, .height = 80, .params = { 100, 100, 50, 40 } };
static const cn_scene scene = { .cameras = &camera, .n_cameras = 1, .views = views, .n_views = N };

/* Cameras in a row, 0.5 m apart along x, 2 m above the ground, that look along y. */
static int begin(void **state)
{
    (void)state;
    for (int i = 0; i < N; i++) {
        const double turn[9] = { 1, 0, 0, 0, 0, -1, 0, 1, 0 };
        views[i] = (cn_view){ .translation = { -0.5 * i, 2, 0 } };
        memcpy(views[i].rotation, turn, sizeof turn);
    }
    return 0;
}

static void test_places(void **state)
{
    (void)state;
    cn_clear_space space;
    const struct {
        double place[3], reach_m;
        bool held;
    } cases[] = {
        { { 5, 1, 2 }, 0, true },       { { 5, 2.9, 2 }, 0, true },    { { 5, 3.1, 2 }, 0, false },
        { { 5, -1, 2 }, 0, false },     { { 5, 1, 0 }, 0, false },     { { 5, 0.2, 0 }, 0.05, false },
        { { 5, 2.5, 0 }, 0, false },    { { -0.5, 1, 2 }, 0, true },   { { -0.55, 1, 2 }, 0, false },
        { { -0.55, 1, 2 }, 0.1, true }, { { 5, -0.1, 2 }, 0.2, true }, { { 5, -0.3, 2 }, 0.2, false },
        { { 19.5, 1, 2.39 }, 0, true }, { { 40, 1, 2 }, 0, false },    { { 5, 1, 2.5 }, 0, false },
        { { 5, 1, 2.5 }, 0.15, true },
    };
    assert_int_equal(cn_clear_space_init(&space, &scene, NEAR), CN_OK);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        if (cn_clear_space_holds(&space, cases[i].place, cases[i].reach_m) != cases[i].held) fail_msg("case %zu", i);
    cn_clear_space_deinit(&space);
}

static void test_none(void **state)
{
    (void)state;
    cn_clear_space space;
    assert_int_equal(cn_clear_space_init(&space, &scene, 0), CN_OK);
    assert_false(cn_clear_space_holds(&space, (const double[3]){ 5, 1, 2 }, 1));
    cn_clear_space_deinit(&space);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_places), cmocka_unit_test(test_none) };
    return cmocka_run_group_tests(tests, begin, NULL);
}
