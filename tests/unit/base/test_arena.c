#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>

#include <cmocka.h>

#include "base/arena.h"

#include <string.h>

typedef struct parts {
    double *doubles;
    char *bytes;
    float *floats;
} parts;

static parts carve(cn_arena *arena)
{
    parts p;
    p.doubles = CN_ARENA_NEW(arena, double, 100);
    p.bytes = CN_ARENA_NEW(arena, char, 3);
    p.floats = CN_ARENA_NEW(arena, float, 1000);
    return p;
}

static void counting_and_carving_agree(void **state)
{
    (void)state;
    cn_arena count, arena;
    cn_arena_count(&count);
    parts none = carve(&count);
    assert_null(none.doubles);
    assert_null(none.floats);
    assert_int_equal(cn_arena_init(&arena, count.used), CN_OK);
    parts p = carve(&arena);
    assert_int_equal(arena.used, count.used);
    assert_int_equal((uintptr_t)p.doubles % CN_ARENA_ALIGN, 0);
    assert_int_equal((uintptr_t)p.bytes % CN_ARENA_ALIGN, 0);
    assert_int_equal((uintptr_t)p.floats % CN_ARENA_ALIGN, 0);
    for (int i = 0; i < 1000; i++)
        assert_true(p.floats[i] == 0);
    memset(p.doubles, 1, 100 * sizeof *p.doubles);
    memset(p.bytes, 2, 3);
    memset(p.floats, 3, 1000 * sizeof *p.floats);
    assert_int_equal(((unsigned char *)p.doubles)[799], 1);
    assert_int_equal(p.bytes[2], 2);
    assert_null(CN_ARENA_NEW(&arena, char, 1));
    cn_arena_deinit(&arena);
    assert_null(arena.base);
}

static void sums_that_do_not_fit_are_refused(void **state)
{
    (void)state;
    cn_arena count, arena;
    cn_arena_count(&count);
    cn_arena_take(&count, SIZE_MAX / 4, 8);
    cn_arena_take(&count, 1, 8);
    assert_true(count.used == SIZE_MAX);
    assert_int_equal(cn_arena_init(&arena, count.used), CN_ERR_NOMEM);
    assert_non_null(strstr(cn_error_message(), "out of memory"));
    cn_arena_deinit(&arena);

    assert_int_equal(cn_arena_init(&arena, 256), CN_OK);
    assert_null(cn_arena_take(&arena, SIZE_MAX / 4, 8));
    assert_null(cn_arena_take(&arena, SIZE_MAX, 1));
    assert_non_null(cn_arena_take(&arena, 256, 1));
    cn_arena_deinit(&arena);
}

static void an_empty_arena_is_fine(void **state)
{
    (void)state;
    cn_arena arena;
    assert_int_equal(cn_arena_init(&arena, 0), CN_OK);
    assert_non_null(cn_arena_take(&arena, 0, 8));
    assert_null(cn_arena_take(&arena, 1, 1));
    cn_arena_deinit(&arena);
    cn_arena_deinit(&arena);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(counting_and_carving_agree),
        cmocka_unit_test(sums_that_do_not_fit_are_refused),
        cmocka_unit_test(an_empty_arena_is_fine),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
