#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>

#include <cmocka.h>

#include "base/rng.h"
#include "math/linalg.h"

#include <math.h>
#include <string.h>

static void expect_near(double a, double b, double tolerance)
{
    if (!(fabs(a - b) <= tolerance)) fail_msg("%.17g is not within %g of %.17g", a, tolerance, b);
}

static void expect_all_near(const double *a, const double *b, int n, double tolerance)
{
    for (int i = 0; i < n; i++)
        expect_near(a[i], b[i], tolerance);
}

/* [-1, 1) */
static double noise(uint64_t stream, uint64_t counter)
{
    return 2.0 * (double)cn_rng_float(11, stream, counter) - 1;
}

static void vectors(void **state)
{
    (void)state;
    const double x[3] = { 1, 0, 0 }, y[3] = { 0, 1, 0 }, z[3] = { 0, 0, 1 }, d[3] = { 2, 3, 6 };
    double out[3];
    cn_cross3(x, y, out);
    expect_all_near(out, z, 3, 0);
    expect_near(cn_norm3(d), 7, 1e-15);
    expect_near(cn_distance3(d, (const double[3]){ 2, 0, 2 }), 5, 1e-15);
    double unit[3] = { 3, 0, 4 };
    assert_true(cn_normalize3(unit));
    expect_all_near(unit, (const double[3]){ 0.6, 0, 0.8 }, 3, 1e-16);
    double zero[3] = { 0, 0, 0 }, bad[3] = { 1, INFINITY, 0 }, nan3[3] = { NAN, 1, 0 };
    assert_false(cn_normalize3(zero));
    assert_false(cn_normalize3(bad));
    assert_false(cn_normalize3(nan3));
    assert_true(zero[0] == 0 && bad[0] == 1 && nan3[1] == 1);
}

static void matrices(void **state)
{
    (void)state;
    const double a[9] = { 1, 2, 3, 4, 5, 6, 7, 8, 10 }, b[9] = { 2, 0, 1, 0, 1, 0, 1, 0, 3 }, v[3] = { 1, -1, 2 };
    double m[9], t[9], out[3], expected[3];
    cn_mat3_mul(a, b, m);
    expect_all_near(m, (const double[9]){ 5, 2, 10, 14, 5, 22, 24, 8, 37 }, 9, 0);
    cn_mat3_vec(a, v, out);
    expect_all_near(out, (const double[3]){ 5, 11, 19 }, 3, 0);
    cn_mat3_transpose(a, t);
    cn_mat3_vec(t, v, expected);
    cn_mat3_tvec(a, v, out);
    expect_all_near(out, expected, 3, 0);
    expect_all_near(out, (const double[3]){ 11, 13, 17 }, 3, 0);
}

static void quaternions_turn_as_they_should(void **state)
{
    (void)state;
    const double h = sqrt(0.5);
    double m[9], out[3];
    /* A quarter turn about z takes x to y. */
    cn_quat_to_mat3((const double[4]){ h, 0, 0, h }, m);
    cn_mat3_vec(m, (const double[3]){ 1, 0, 0 }, out);
    expect_all_near(out, (const double[3]){ 0, 1, 0 }, 3, 1e-15);
    /* The quaternion's length does not matter. A zero quaternion gives the identity. */
    cn_quat_to_mat3((const double[4]){ 5, 0, 0, 5 }, m);
    expect_near(m[3], 1, 1e-15);
    cn_quat_to_mat3((const double[4]){ 0, 0, 0, 0 }, m);
    expect_all_near(m, (const double[9]){ 1, 0, 0, 0, 1, 0, 0, 0, 1 }, 9, 0);
}

static void quaternion_and_matrix_agree(void **state)
{
    (void)state;
    for (uint64_t i = 0; i < 200; i++) {
        double q[4], back[4], m[9], t[9], product[9], length = 0;
        for (uint64_t k = 0; k < 4; k++) {
            q[k] = noise(i, k);
            if (i % 5 == k + 1) q[k] *= 1e-9; /* near the half turns, where a careless inverse divides by nothing */
            length += q[k] * q[k];
        }
        for (int k = 0; k < 4; k++)
            q[k] /= sqrt(length);
        cn_quat_to_mat3(q, m);
        cn_mat3_transpose(m, t);
        cn_mat3_mul(m, t, product);
        expect_all_near(product, (const double[9]){ 1, 0, 0, 0, 1, 0, 0, 0, 1 }, 9, 1e-14);
        cn_mat3_to_quat(m, back);
        assert_true(back[0] >= 0);
        double same = 0;
        for (int k = 0; k < 4; k++)
            same += q[k] * back[k];
        expect_near(fabs(same), 1, 1e-14);
    }
    /* Half turns about each axis. */
    const double turns[3][9] = { { 1, 0, 0, 0, -1, 0, 0, 0, -1 },
                                 { -1, 0, 0, 0, 1, 0, 0, 0, -1 },
                                 { -1, 0, 0, 0, -1, 0, 0, 0, 1 } };
    for (int axis = 0; axis < 3; axis++) {
        double q[4];
        cn_mat3_to_quat(turns[axis], q);
        for (int k = 0; k < 4; k++)
            expect_near(fabs(q[k]), k == axis + 1, 1e-15);
    }
}

static void slerp_is_even_and_short(void **state)
{
    (void)state;
    const double pi = acos(-1);
    const double a[4] = { 1, 0, 0, 0 }, b[4] = { cos(pi / 4), 0, 0, sin(pi / 4) };
    const double minus_b[4] = { -b[0], -b[1], -b[2], -b[3] };
    double out[4];
    for (int step = 0; step <= 4; step++) {
        const double angle = pi / 4 * step / 4;
        const double expected[4] = { cos(angle), 0, 0, sin(angle) };
        cn_quat_slerp(a, b, step / 4.0, out);
        expect_all_near(out, expected, 4, 1e-15);
        cn_quat_slerp(a, minus_b, step / 4.0, out);
        expect_all_near(out, expected, 4, 1e-15);
    }
    const double close[4] = { 1, 1e-9, 0, 0 };
    cn_quat_slerp(a, close, 0.5, out);
    expect_all_near(out, (const double[4]){ 1, 5e-10, 0, 0 }, 4, 1e-15);
    cn_quat_slerp(a, a, 0.3, out);
    expect_all_near(out, a, 4, 0);
}

static void check_eigen(int n, const double *a, double tolerance)
{
    double values[4], v[16];
    cn_eigen_symmetric(n, a, values, v);
    for (int j = 0; j < n; j++) {
        if (j > 0) assert_true(values[j] >= values[j - 1]);
        for (int i = 0; i < n; i++) {
            double av = 0, vv = 0;
            for (int k = 0; k < n; k++) {
                av += a[i * n + k] * v[k * n + j];
                vv += v[k * n + i] * v[k * n + j];
            }
            expect_near(av, values[j] * v[i * n + j], tolerance);
            expect_near(vv, i == j, 1e-14);
        }
    }
}

static void eigenvalues_of_known_matrices(void **state)
{
    (void)state;
    double values[4], v[16];
    cn_eigen_symmetric(2, (const double[4]){ 2, 1, 1, 2 }, values, v);
    expect_all_near(values, (const double[2]){ 1, 3 }, 2, 1e-15);
    /* The second difference: 2 - 2 cos(k pi / 4). */
    const double d[9] = { 2, -1, 0, -1, 2, -1, 0, -1, 2 };
    cn_eigen_symmetric(3, d, values, v);
    expect_all_near(values, (const double[3]){ 2 - sqrt(2), 2, 2 + sqrt(2) }, 3, 1e-14);
    cn_eigen_symmetric(3, (const double[9]){ 3, 0, 0, 0, -1, 0, 0, 0, 2 }, values, v);
    expect_all_near(values, (const double[3]){ -1, 2, 3 }, 3, 0);
    cn_eigen_symmetric(1, (const double[1]){ 5 }, values, v);
    expect_near(values[0], 5, 0);
    expect_near(v[0], 1, 0);
    const double zero[16] = { 0 };
    check_eigen(4, zero, 0);
}

static void eigenvectors_of_random_matrices(void **state)
{
    (void)state;
    for (uint64_t trial = 0; trial < 200; trial++) {
        const int n = 2 + (int)(trial % 3);
        const double scale = trial % 7 == 0 ? 1e8 : 1;
        double a[16];
        for (int i = 0; i < n; i++)
            for (int j = 0; j <= i; j++)
                a[i * n + j] = a[j * n + i] = scale * noise(1000 + trial, (uint64_t)(4 * i + j));
        check_eigen(n, a, 1e-14 * 4 * scale);
    }
}

static void selection_agrees_with_sorting(void **state)
{
    (void)state;
    double values[101];
    for (uint64_t trial = 0; trial < 60; trial++) {
        const size_t n = 1 + trial * 100 / 59;
        for (size_t k = 0; k < n; k += 1 + n / 7) {
            for (size_t i = 0; i < n; i++)
                values[i] = trial % 2 ? floor(4 * noise(trial, i)) : noise(trial, i);
            const double chosen = cn_select(values, n, k);
            size_t below = 0, equal = 0;
            for (size_t i = 0; i < n; i++) {
                below += values[i] < chosen;
                equal += values[i] == chosen;
            }
            assert_true(below <= k && k < below + equal);
        }
    }
    double odd[5] = { NAN, 1, NAN, 0, 2 };
    (void)cn_select(odd, 5, 2); /* no order, but an end */
}

static void test_four_equations(void **state)
{
    (void)state;
    static const double from[4][4] = { { 0, 2, 0, 1 }, { 2, 5, 1, 0 }, { 0, 1, 3, 0 }, { 1, 0, 0, 4 } },
                        x[4][3] = { { 1, 0, 2 }, { -1, 3, 0 }, { 4, 0.5, -2 }, { 0, 1, 7 } };
    double a[4][4], b[4][3] = { { 0 } }, singular[4][4] = { { 1, 1 }, { 1, 1 } };
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 4; k++) {
            a[i][k] = from[i][k];
            for (int c = 0; c < 3; c++)
                b[i][c] += from[i][k] * x[k][c];
        }
    assert_true(cn_solve4(a, b)); /* the first pivot is 0 */
    for (int i = 0; i < 4; i++)
        for (int c = 0; c < 3; c++)
            assert_float_equal(b[i][c], x[i][c], 1e-12);
    assert_false(cn_solve4(singular, b));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_four_equations),
        cmocka_unit_test(vectors),
        cmocka_unit_test(matrices),
        cmocka_unit_test(quaternions_turn_as_they_should),
        cmocka_unit_test(quaternion_and_matrix_agree),
        cmocka_unit_test(slerp_is_even_and_short),
        cmocka_unit_test(eigenvalues_of_known_matrices),
        cmocka_unit_test(eigenvectors_of_random_matrices),
        cmocka_unit_test(selection_agrees_with_sorting),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
