/* Charts: text that every reader of XML takes, axes and their ticks, names that do not cover each other. */
#include "svg.h"

#include "base/file.h"
#include "base/rng.h"
#include "chart/axis.h"
#include "chart/labels.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#define PATH "chart-test.svg"

static void finish(cn_chart *chart, char **text)
{
    size_t size;
    assert_int_equal(cn_chart_save(chart, &(cn_chart_page){ "Test", 400, 300 }, PATH), CN_OK);
    assert_int_equal(cn_file_read(PATH, 0, text, &size), CN_OK);
    assert_int_equal(unlink(PATH), 0);
    check_well_formed(*text);
}

static void assert_near(double a, double b, double by)
{
    if (!(fabs(a - b) <= by)) fail_msg("%g is not %g", a, b);
}

/* ---- text ---- */

static void test_any_text(void **state)
{
    (void)state;
    static const char *const cases[][2] = {
        { "a < b && c > d", "a &lt; b &amp;&amp; c > d" },
        { "tab\tbell\a.", "tabbell." },
        { "\xc3\xa9t\xc3\xa9 \xe5\xa4\xa7 \xf0\x9f\x8f\x99", "\xc3\xa9t\xc3\xa9 \xe5\xa4\xa7 \xf0\x9f\x8f\x99" },
        { "caf\xe9.jpg", "caf\xef\xbf\xbd.jpg" },                                   /* Latin 1 */
        { "\xc0\xbc", "\xef\xbf\xbd\xef\xbf\xbd" },                                 /* an overlong '<' */
        { "\xed\xa0\x80", "\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd" },                 /* half a surrogate */
        { "\xef\xbf\xbf", "\xef\xbf\xbd" },                                         /* U+FFFF */
        { "\xf5\x80\x80\x80", "\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd" }, /* beyond U+10FFFF */
        { "cut \xe5\xa4", "cut \xef\xbf\xbd\xef\xbf\xbd" },
    };
    const cn_letters letters = { .size = 12 };
    cn_chart chart;
    char *text;
    assert_int_equal(cn_chart_open(&chart), CN_OK);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        cn_chart_text(&chart, 10, 20, &letters, cases[i][0]);
    finish(&chart, &text);
    const char *at = text;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        at = strstr(at, "<text");
        assert_non_null(at);
        at = strchr(at, '>') + 1;
        assert_memory_equal(at, cases[i][1], strlen(cases[i][1]));
        assert_memory_equal(at + strlen(cases[i][1]), "</text>", 7);
    }
    free(text);
}

/* Every line of a text of random characters is within the width, no character is lost, and none is cut. */
static void test_lines(void **state)
{
    (void)state;
    static const char *const letters[] = { "a", "W", "i", " ", "\xc3\x9f", "\xe5\xa4\xa7", "\xf0\x9f\x8f\x99" };
    const cn_letters small = { .size = 12 };
    for (uint32_t round = 0; round < 200; round++) {
        char all[600] = "", *text, shown[600] = "", wanted[600] = "";
        for (uint32_t i = 0; i < 80; i++)
            strcat(all, letters[cn_rng_below(1, round, i, 7)]);
        cn_chart chart;
        assert_int_equal(cn_chart_open(&chart), CN_OK);
        const cn_text_block block = { 10, 20, 150, 15, ' ', UINT32_MAX };
        const double lowest = cn_chart_wrap(&chart, &block, &small, all);
        finish(&chart, &text);
        uint32_t lines = 0;
        for (const char *p = text; (p = strstr(p, "<text")); lines++) {
            char line[600];
            p = strchr(p, '>') + 1;
            snprintf(line, sizeof line, "%.*s", (int)strcspn(p, "<"), p);
            assert_true(cn_chart_text_width(&small, line) <= 150);
            strcat(shown, line);
        }
        assert_near(lowest, 20 + 15. * lines, 1e-9);
        for (char *from = shown, *to = shown;; from++)
            if (*from != ' ' && !(*to++ = *from)) break;
        for (char *from = all, *to = wanted;; from++)
            if (*from != ' ' && !(*to++ = *from)) break;
        assert_string_equal(shown, wanted);
        free(text);
    }
}

static void test_too_many_lines(void **state)
{
    (void)state;
    cn_chart chart;
    char *text;
    assert_int_equal(cn_chart_open(&chart), CN_OK);
    const cn_text_block block = { 10, 20, 60, 15, ' ', 2 };
    assert_near(cn_chart_wrap(&chart, &block, &(cn_letters){ .size = 12 }, "one two three four five six"), 50, 1e-9);
    finish(&chart, &text);
    assert_non_null(strstr(text, ">one two</text>"));
    assert_non_null(strstr(text, "...</text>"));
    assert_null(strstr(text, "six"));
    free(text);
}

/* ---- shapes ---- */

static void test_what_is_not_finite_is_left_out(void **state)
{
    (void)state;
    static const double bad[] = { NAN, INFINITY, -INFINITY };
    const cn_paint paint = { .fill = "#123456", .stroke = "#654321" };
    cn_chart chart;
    char *text;
    assert_int_equal(cn_chart_open(&chart), CN_OK);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        const double b = bad[i], curve[][2] = { { 1, 1 }, { 2, b }, { b, 2 }, { 3, 3 } };
        cn_plot plot = { .x = cn_axis_from(0, 100), .y = cn_axis_from(100, 0), .x_title = "x", .y_title = "y" };
        for (int k = 0; k < 4; k++)
            cn_axis_include(&plot.x, curve[k][0]), cn_axis_include(&plot.y, curve[k][1]);
        cn_axis_fit(&plot.x, 0), cn_axis_fit(&plot.y, 0);
        assert_near(cn_axis_at(&plot.x, 3), 100, 1e-9);
        cn_plot_frame(&chart, &plot);
        cn_plot_curve(&chart, &plot, curve, 4, "#777777");
        cn_plot_limit(&chart, &plot, b, "limit");
        cn_chart_rect(&chart, &(cn_box){ 0, b, 1, 1 }, 0, &paint);
        cn_chart_circle(&chart, 1, 1, b, &paint);
        cn_chart_line(&chart, &(cn_box){ b, 0, 1, 1 }, &paint);
        cn_chart_polyline(&chart, curve, 4, &paint);
        cn_chart_path(&chart, "M0 0h1", &(cn_pose2){ 0, 0, b }, &paint);
        cn_chart_text(&chart, b, 1, &(cn_letters){ .size = 12 }, "nowhere");
        cn_chart_bar(&chart, &plot.x, b, 10, "#888888");
    }
    finish(&chart, &text);
    assert_null(strstr(text, "nowhere"));
    assert_null(strstr(text, "#888888"));
    free(text);
}

static void test_nothing_half_written(void **state)
{
    (void)state;
    cn_chart chart;
    assert_int_equal(cn_chart_open(&chart), CN_OK);
    assert_int_equal(cn_chart_save(&chart, &(cn_chart_page){ "Test", 10, 10 }, "no/such/folder.svg"), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), "no/such/folder.svg"));
    cn_chart_discard(&chart);
    assert_int_equal(cn_chart_open(&chart), CN_OK);
    cn_chart_discard(&chart);
    assert_int_equal(access(PATH, F_OK), -1);
}

/* ---- axes ---- */

static void check_axis(const cn_axis *a, double low, double high)
{
    double ticks[CN_AXIS_TICKS];
    const uint32_t n = cn_axis_ticks(a, ticks);
    const double slack = 1e-5 * (a->high - a->low);
    assert_true(slack > 0 && a->low <= low + slack && a->high >= high - slack);
    assert_true(n >= 2 && n <= 12);
    for (uint32_t i = 0; i < n; i++) {
        char text[32];
        const double at = cn_axis_at(a, ticks[i]);
        assert_true(at > a->start - 1e-3 && at < a->end + 1e-3);
        if (i > 0) assert_true(ticks[i] > ticks[i - 1]);
        cn_axis_print(a, ticks[i], text);
        assert_true(*text && strlen(text) < sizeof text - 1);
    }
    assert_near(cn_axis_at(a, a->low), a->start, 1e-6);
    assert_near(cn_axis_at(a, a->high), a->end, 1e-6);
    if (a->ends_at_ticks && !a->logarithmic) {
        assert_near(ticks[0], a->low, 1e-6 * (a->high - a->low));
        assert_near(ticks[n - 1], a->high, 1e-6 * (a->high - a->low));
    }
}

static void test_axes(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < 20000; i++) {
        const double size = pow(10, 16 * cn_rng_float(2, i, 0) - 8), shift = 4 * cn_rng_float(2, i, 1) - 2;
        const double spread = i % 5 == 0 ? 0 : pow(10, -3 * cn_rng_float(2, i, 2));
        cn_axis a = cn_axis_from(20, 420);
        a.ends_at_ticks = i % 2;
        a.logarithmic = i % 3 == 0;
        double low = size * (a.logarithmic ? 1 : shift), high = low + size * spread;
        if (a.logarithmic) high = low * pow(10, 12 * cn_rng_float(2, i, 3) * (spread > 0));
        cn_axis_include(&a, low);
        cn_axis_include(&a, high);
        cn_axis_fit(&a, i % 4 ? 0 : 0.1);
        check_axis(&a, low, high);
    }
    for (int logarithmic = 0; logarithmic < 2; logarithmic++) {
        cn_axis a = cn_axis_from(20, 420); /* of no value, and of one that a logarithm does not take */
        a.logarithmic = logarithmic;
        if (logarithmic) cn_axis_include(&a, -3);
        cn_axis_include(&a, NAN);
        cn_axis_fit(&a, 0);
        check_axis(&a, logarithmic, logarithmic);
    }
}

static void test_numbers(void **state)
{
    (void)state;
    static const struct {
        double value;
        bool logarithmic;
        const char *text;
    } cases[] = {
        { 0.5, true, "0.5" },      { 10000, true, "10000" },
        { 1e6, true, "10\u2076" }, { 1e-12, true, "10\u207b\u00b9\u00b2" },
        { 1e6, false, "1e+06" },   { 3 * 0.1, false, "0.3" },
        { -0.0, false, "0" },      { 2e5, true, "200000" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[32];
        cn_axis_print(&(cn_axis){ .logarithmic = cases[i].logarithmic }, cases[i].value, text);
        assert_string_equal(text, cases[i].text);
    }
    assert_near(cn_round_down(9.9), 5, 1e-12);
    assert_near(cn_round_down(2000), 2000, 1e-9);
    assert_near(cn_round_down(0.0199), 0.01, 1e-12);
}

/* ---- names ---- */

static void test_names_keep_apart(void **state)
{
    (void)state;
    const cn_letters letters = { .size = 12 };
    cn_labels labels = { .area = { 0, 0, 400, 300 } };
    uint32_t placed = 0;
    for (uint32_t i = 0; i < 100; i++) {
        const cn_labelled of = { 400 * cn_rng_float(3, i, 0), 300 * cn_rng_float(3, i, 1), 5, 1, 2 };
        cn_box box;
        const double harm = cn_labels_place(&labels, &of, &letters, "a name", &box);
        bool free_of_all = box.x0 > 0 && box.y0 > 0 && box.x1 < 400 && box.y1 < 300;
        for (uint32_t k = 0; k < labels.n; k++)
            free_of_all = free_of_all && !cn_box_overlap(&box, &labels.taken[k]);
        assert_int_equal(harm == 0, free_of_all);
        assert_true(box.x1 - box.x0 >= cn_chart_text_width(&letters, "a name"));
        if (harm > 0) continue;
        cn_labels_avoid(&labels, &box, 1);
        placed++;
    }
    assert_true(placed > 40);
    for (uint32_t i = 0; i < 2 * CN_LABELS_MOST; i++)
        cn_labels_avoid(&labels, &labels.area, 1);
    assert_int_equal(labels.n, CN_LABELS_MOST);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_any_text),
        cmocka_unit_test(test_lines),
        cmocka_unit_test(test_too_many_lines),
        cmocka_unit_test(test_what_is_not_finite_is_left_out),
        cmocka_unit_test(test_nothing_half_written),
        cmocka_unit_test(test_axes),
        cmocka_unit_test(test_numbers),
        cmocka_unit_test(test_names_keep_apart),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
