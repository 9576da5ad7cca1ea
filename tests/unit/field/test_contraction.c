/* The gradient of the contraction, against differences of the places that a march gives. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/rng.h"
#include "field/field.h"

#include <math.h>

static float uniform(unsigned stream, size_t i)
{
    return cn_rng_float(5, stream, i);
}

static void test_contraction(void **state)
{
    (void)state;
    for (size_t i = 0; i < 200; i++) {
        float x[3], g[3], d_x[3];
        for (size_t a = 0; a < 3; a++)
            x[a] = 6 * uniform(6, 3 * i + a) - 3, g[a] = 2 * uniform(7, 3 * i + a) - 1;
        cn_field_uncontract_gradient(x, g, d_x);
        for (int a = 0; a < 3; a++) {
            double sum[2];
            for (int side = 0; side < 2; side++) {
                float moved[3] = { x[0], x[1], x[2] }, t = 1, length, pos[3 * CN_PANEL] = { 0 };
                moved[a] += side ? 1e-3f : -1e-3f;
                const cn_box_ray ray = { { moved[0], moved[1], moved[2] }, { 0, 0, 0 } };
                cn_kernel_ref.place(&ray, &t, 1, (cn_spacing){ 0.01f, 1 }, (cn_lanes){ pos, 0 }, &length);
                sum[side] = 0;
                for (size_t b = 0; b < 3; b++)
                    sum[side] += (double)g[b] * (double)pos[b * CN_PANEL];
            }
            const double numeric = (sum[1] - sum[0]) / 2e-3;
            if (fabs(fabs(x[0]) - 1) < 2e-3 || fabs(fabs(x[1]) - 1) < 2e-3 || fabs(fabs(x[2]) - 1) < 2e-3) continue;
            assert_true(fabs(numeric - (double)d_x[a]) < 2e-3 + 0.02 * fabs(numeric));
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_contraction) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
