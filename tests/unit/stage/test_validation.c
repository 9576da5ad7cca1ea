/* The validation photos, which decide when training stops, are used neither for training nor for the score. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "stage/validation.h"

#include <stdbool.h>

enum { VIEWS = 90 };

static bool has(const uint32_t *list, uint32_t n, uint32_t view)
{
    for (uint32_t i = 0; i < n; i++)
        if (list[i] == view) return true;
    return false;
}

static void ascending(const uint32_t *list, uint32_t n)
{
    for (uint32_t i = 1; i < n; i++)
        assert_true(list[i - 1] < list[i]);
}

/* Every eighth of n views is held out. */
static uint32_t check(uint32_t n)
{
    uint32_t photos[VIEWS], held_out[VIEWS];
    cn_plan_tile tile = { .id = "t", .photos = photos, .held_out = held_out };
    for (uint32_t i = 0; i < n; i++)
        if (i % 8)
            photos[tile.n_photos++] = i;
        else
            held_out[tile.n_held_out++] = i;
    cn_validation v;
    assert_int_equal(cn_validation_init(&v, &tile), CN_OK);
    const cn_plan_tile *train = &v.train, *validate = &v.validate;
    ascending(train->photos, train->n_photos);
    ascending(train->held_out, train->n_held_out);
    ascending(validate->held_out, validate->n_held_out);
    assert_int_equal(train->n_photos + validate->n_held_out, tile.n_photos);
    assert_int_equal(train->n_held_out, tile.n_held_out + validate->n_held_out);
    for (uint32_t i = 0; i < validate->n_held_out; i++) {
        assert_true(has(photos, tile.n_photos, validate->held_out[i]));
        assert_false(has(held_out, tile.n_held_out, validate->held_out[i]));
        assert_false(has(train->photos, train->n_photos, validate->held_out[i]));
        assert_true(has(train->held_out, train->n_held_out, validate->held_out[i]));
    }
    for (uint32_t i = 0; i < tile.n_held_out; i++)
        assert_true(has(train->held_out, train->n_held_out, held_out[i]));
    const uint32_t count = validate->n_held_out;
    cn_validation_deinit(&v);
    return count;
}

static void test_photos_of_their_own(void **state)
{
    (void)state;
    for (uint32_t n = 0; n <= VIEWS; n++)
        (void)check(n);
    assert_int_equal(check(6), 0);
    assert_int_equal(check(12), 1);
    assert_int_equal(check(VIEWS), CN_VALIDATION_MOST);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_photos_of_their_own) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
