/* The charts of `conurb tradeoff`, with results that are hard to draw. */
#include "../chart/svg.h"

#include "base/file.h"
#include "stage/tradeoff_chart.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#define PATH "tradeoff-chart-test.svg"

static void check_file(const char *name)
{
    char *text;
    size_t size;
    assert_int_equal(cn_file_read(PATH, 0, &text, &size), CN_OK);
    assert_int_equal(unlink(PATH), 0);
    check_well_formed(text);
    if (name) assert_non_null(strstr(text, name));
    free(text);
}

static void check_charts(cn_tradeoff_row *rows, uint32_t n, const char *name)
{
    const cn_tradeoff t = { rows, n };
    assert_int_equal(cn_tradeoff_draw_front(&t, PATH), CN_OK);
    check_file(name);
    assert_int_equal(cn_tradeoff_draw_fields(&t, PATH), CN_OK);
    check_file(name);
    if (n) rows[0].depth_error_m = 0.2;
    assert_int_equal(cn_tradeoff_draw_fields(&t, PATH), CN_OK);
    check_file(n ? "error of depth" : NULL);
    assert_int_equal(cn_tradeoff_draw_effects(&t, PATH), CN_OK);
    check_file(n > 1 ? "(off)" : NULL);
}

static void test_few(void **state)
{
    (void)state;
    cn_tradeoff_row rows[] = { { "base", 60, 0.3, 3e8, 24, 25, 0.8, 2e7, NAN, NAN },
                               { "with-sky", 70, 0.3, 4e8, 25, 26, 0.8, 2e7, NAN, NAN } };
    check_charts(rows, 0, NULL);
    check_charts(rows, 1, "base");
    check_charts(rows, 2, "with-sky");
}

/* A training that failed leaves no figures: the others are drawn. */
static void test_not_measured(void **state)
{
    (void)state;
    cn_tradeoff_row rows[] = { { "base", 60, 0.3, 3e8, 24, 25, 0.8, 2e7, NAN, NAN },
                               { "with-sky", NAN, NAN, NAN, NAN, NAN, 0.8, 2e7, NAN, NAN },
                               { "with-exposure", 0, 0, 0, INFINITY, -INFINITY, 0.8, 2e7, NAN, NAN },
                               { "with-transient", 70, 0.4, 3e8, 25, NAN, 0.8, 2e7, NAN, NAN } };
    check_charts(rows, 4, "with-transient");
}

static void test_many(void **state)
{
    (void)state;
    static cn_tradeoff_row rows[200];
    for (uint32_t i = 0; i < 200; i++) {
        rows[i] = (cn_tradeoff_row){ "", 60 + i % 7, 0.3, 3e8, 24 + 0.001 * i, 25, 0.8, 2e7, NAN, NAN };
        snprintf(rows[i].name, sizeof rows[i].name, "with-a-name-that-is-rather-long-%u", i);
    }
    check_charts(rows, 200, "rather-long-0");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_few),
        cmocka_unit_test(test_not_measured),
        cmocka_unit_test(test_many),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
