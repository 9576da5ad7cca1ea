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
    const cn_tradeoff t = { rows, n, false };
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
    cn_tradeoff_row rows[] = { { "base", 60, 0.3, 3e8, 24, 25, 0.8, 2e7, NAN, NAN, 26, "" },
                               { "with-sky", 70, 0.3, 4e8, 25, 26, 0.8, 2e7, NAN, NAN, 26, "" } };
    check_charts(rows, 0, NULL);
    check_charts(rows, 1, "base");
    check_charts(rows, 2, "with-sky");
}

/* A training that failed leaves no figures: the others are drawn. */
static void test_not_measured(void **state)
{
    (void)state;
    cn_tradeoff_row rows[] = { { "base", 60, 0.3, 3e8, 24, 25, 0.8, 2e7, NAN, NAN, 26, "" },
                               { "with-sky", NAN, NAN, NAN, NAN, NAN, 0.8, 2e7, NAN, NAN, 26, "" },
                               { "with-exposure", 0, 0, 0, INFINITY, -INFINITY, 0.8, 2e7, NAN, NAN, 26, "" },
                               { "with-transient", 70, 0.4, 3e8, 25, NAN, 0.8, 2e7, NAN, NAN, 26, "" } };
    check_charts(rows, 4, "with-transient");
}

static void test_many(void **state)
{
    (void)state;
    static cn_tradeoff_row rows[200];
    for (uint32_t i = 0; i < 200; i++) {
        rows[i] = (cn_tradeoff_row){ "", 60 + i % 7, 0.3, 3e8, 24 + 0.001 * i, 25, 0.8, 2e7, NAN, NAN, 26, "" };
        snprintf(rows[i].name, sizeof rows[i].name, "with-a-name-that-is-rather-long-%u", i);
    }
    check_charts(rows, 200, "rather-long-0");
}

/* What a type far behind the best lacks is in the table and below the chart. */
static void test_why(void **state)
{
    (void)state;
    cn_tradeoff_row rows[] = { { "hash", 18, 1, 8e7, 27.9, 28.5, 0.79, 7e6, NAN, NAN, 28.6, "" },
                               { "dense", 14, 1, 8e7, 26.9, 26.4, 0.74, 7e6, NAN, NAN, 27, "" },
                               { "voxels", 26, 8, 8e7, 20, 20.3, 0.63, 7e6, NAN, NAN, 23.4, "" },
                               { "nerf", 34, 3, 8e7, 19, 19.4, 0.61, 7e6, NAN, NAN, 19.5, "" } };
    cn_tradeoff t = { rows, 4, false };
    cn_tradeoff_say_why(&t);
    assert_string_equal(rows[0].why, "");
    assert_string_equal(rows[1].why, "");
    assert_string_equal(rows[2].why,
                        "its training photos are at 23.4 dB, those of hash at 28.6: more steps or a larger field; "
                        "held-out photos are 3.4 dB below them, with hash 0.7: more photos");
    assert_string_equal(rows[3].why,
                        "its training photos are at 19.5 dB, those of hash at 28.6: more steps or a larger field");
    assert_int_equal(cn_tradeoff_draw_fields(&t, PATH), CN_OK);
    check_file("voxels lacks: its training photos are at 23.4 dB");
}

/* Where each photo has its own light, the field that is best in the mean light may be the worst. */
static void test_fitted(void **state)
{
    (void)state;
    cn_tradeoff_row rows[] = { { "hash", 20, 0.3, 8e7, 15.9, 20.3, 0.7, 7e6, 0.16, 0.4, 23.9, "" },
                               { "voxels", 21, 0.4, 8e7, 17.6, 17.3, 0.6, 9e6, 0.26, 0.3, 22.5, "" } };
    cn_tradeoff t = { rows, 2, true };
    cn_tradeoff_say_why(&t);
    assert_string_equal(rows[0].why, "");
    assert_non_null(strstr(rows[1].why, "with hash 3.6"));
    assert_int_equal(cn_tradeoff_draw_fields(&t, PATH), CN_OK);
    check_file("light fitted");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_few), cmocka_unit_test(test_not_measured), cmocka_unit_test(test_many),
        cmocka_unit_test(test_why), cmocka_unit_test(test_fitted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
