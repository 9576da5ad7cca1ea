#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>

#include <cmocka.h>

#include "base/rng.h"

/* Fixed values: a tile trained twice from one seed must have the same bytes on any machine. */
static void bits_never_change(void **state)
{
    (void)state;
    assert_true(cn_rng_u64(0, 0, 0) == UINT64_C(0xa706dd2f4d197e6f));
    assert_true(cn_rng_u64(1, 2, 3) == UINT64_C(0x0ee3bb459e9e297b));
    assert_true(cn_rng_u64(42, UINT64_MAX, UINT64_MAX) == UINT64_C(0x97ea87f7e45c00a5));
}

static void keys_are_told_apart(void **state)
{
    (void)state;
    assert_true(cn_rng_u64(1, 0, 0) != cn_rng_u64(0, 1, 0));
    assert_true(cn_rng_u64(0, 1, 0) != cn_rng_u64(0, 0, 1));
    assert_true(cn_rng_u64(1, 0, 0) != cn_rng_u64(0, 0, 1));
}

static void floats_fill_the_unit_interval(void **state)
{
    (void)state;
    enum { N = 100000 };
    double sum = 0, squares = 0, lag = 0;
    float least = 1, most = 0, before = 0.5f;
    for (uint64_t i = 0; i < N; i++) {
        const float x = cn_rng_float(7, 3, i);
        sum += x;
        squares += (double)x * x;
        lag += ((double)x - 0.5) * ((double)before - 0.5);
        before = x;
        least = x < least ? x : least;
        most = x > most ? x : most;
    }
    assert_true(least >= 0 && least < 1e-3f);
    assert_true(most < 1 && most > 0.999f);
    /* Five standard errors of each. */
    assert_true(sum / N > 0.5 - 0.0046 && sum / N < 0.5 + 0.0046);
    assert_true(squares / N > 1.0 / 3 - 0.0048 && squares / N < 1.0 / 3 + 0.0048);
    assert_true(lag / N > -0.00132 && lag / N < 0.00132);
}

static void below_is_below_and_even(void **state)
{
    (void)state;
    enum { N = 70000, SIDES = 7 };
    int counts[SIDES] = { 0 };
    for (uint64_t i = 0; i < N; i++) {
        const uint32_t side = cn_rng_below(9, 1, i, SIDES);
        assert_true(side < SIDES);
        counts[side]++;
    }
    for (int k = 0; k < SIDES; k++)
        assert_in_range(counts[k], 10000 - 470, 10000 + 470);
    assert_int_equal(cn_rng_below(9, 1, 5, 1), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bits_never_change),
        cmocka_unit_test(keys_are_told_apart),
        cmocka_unit_test(floats_fill_the_unit_interval),
        cmocka_unit_test(below_is_below_and_even),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
