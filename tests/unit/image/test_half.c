#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "image/image.h"

#include <math.h>
#include <stdlib.h>

static void every_half_returns_to_itself(void **state)
{
    (void)state;
    for (uint32_t h = 0; h < 0x10000; h++) {
        const float x = cn_half_to_float((uint16_t)h);
        const uint32_t rest = h & 0x7fff;
        if (rest > 0x7c00) {
            assert_true(isnan(x));
            assert_true((cn_half_from_float(x) & 0x7fff) > 0x7c00);
        } else if (rest == 0x7c00) {
            assert_true(isinf(x));
            assert_int_equal(cn_half_from_float(x), (h & 0x8000) | 0x7bff);
        } else {
            assert_int_equal(cn_half_from_float(x), h);
        }
    }
}

/* Between two neighbours: to the nearer; exactly in the middle: to the even one. */
static void rounds_to_nearest_even(void **state)
{
    (void)state;
    for (uint32_t h = 0; h < 0x7bff; h++) {
        const float low = cn_half_to_float((uint16_t)h), high = cn_half_to_float((uint16_t)(h + 1));
        const float middle = 0.5f * (low + high); /* exact: one more bit */
        assert_int_equal(cn_half_from_float(middle), h % 2 ? h + 1 : h);
        assert_int_equal(cn_half_from_float(nextafterf(middle, 0)), h);
        assert_int_equal(cn_half_from_float(nextafterf(middle, INFINITY)), h + 1);
        assert_int_equal(cn_half_from_float(-middle), 0x8000 | (h % 2 ? h + 1 : h));
    }
}

static void the_range_saturates(void **state)
{
    (void)state;
    static const float big[] = { 65504, 65519, 65520, 65536, 1e9f, 3.4e38f, INFINITY };
    for (size_t i = 0; i < sizeof big / sizeof *big; i++) {
        assert_float_equal(cn_half_to_float(cn_half_from_float(big[i])), 65504, 0);
        assert_float_equal(cn_half_to_float(cn_half_from_float(-big[i])), -65504, 0);
    }
    assert_int_equal(cn_half_from_float(1e-30f), 0);
    assert_int_equal(cn_half_from_float(-0.0f), 0x8000);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_half_returns_to_itself),
        cmocka_unit_test(rounds_to_nearest_even),
        cmocka_unit_test(the_range_saturates),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
