/* Numbers under a locale with a decimal comma, which a program that uses the library may have set. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../common.h"
#include "base/file.h"
#include "base/hash.h"
#include "base/json.h"
#include "base/number.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char folder[] = "/tmp/conurb-number-XXXXXX";

/* The system's German, or one that localedef makes in a folder of its own. */
static bool set_comma_locale(void)
{
    if (setlocale(LC_ALL, "de_DE.UTF-8")) return true;
    char command[256];
    snprintf(command, sizeof command, "localedef -i de_DE -f UTF-8 %s/de_DE.UTF-8 >%s/log 2>&1", folder, folder);
    if (system(command) < 0) return false;
    setenv("LOCPATH", folder, 1);
    return setlocale(LC_ALL, "de_DE.UTF-8") != NULL;
}

static const char *plain(double value)
{
    static char text[32];
    snprintf(text, sizeof text, "%g", value);
    return text;
}

static void numbers_are_written_with_dots(void **state)
{
    (void)state;
    assert_string_equal(plain(0.5), "0,5"); /* else nothing is tested */
    char *text = cn_format("%g %s", 0.5, "a,b"), printed[16];
    assert_string_equal(text, "0.5 a,b");
    free(text);
    assert_int_equal(cn_print(printed, sizeof printed, "%.2f", 1234.5), 7);
    assert_string_equal(printed, "1234.50");
    assert_int_equal(cn_fail(CN_ERR_DATA, "%g", 1.5), CN_ERR_DATA);
    assert_string_equal(cn_error_message(), "1.5");
    assert_string_equal(plain(0.5), "0,5"); /* the caller's locale is as it was */
}

static void numbers_are_read_with_dots(void **state)
{
    (void)state;
    char *end;
    assert_true(cn_parse_double("-2.25e1 rest", &end) == -22.5);
    assert_string_equal(end, " rest");
    assert_true(cn_parse_double("3,5", &end) == 3);
    assert_string_equal(end, ",5");
    assert_true(cn_parse_double("none", &end) == 0);
    assert_string_equal(end, "none");
}

/* Such hashes say what is done, so they must not change with the locale. */
static void a_hash_does_not_go_by_the_locale(void **state)
{
    (void)state;
    const uint64_t comma = cn_hash_text(1, "%.9g", 0.25);
    const locale_t before = cn_number_begin();
    const uint64_t dot = cn_hash_text(1, "%.9g", 0.25);
    cn_number_end(before);
    assert_true(comma == dot);
}

static void pairs_nest(void **state)
{
    (void)state;
    const locale_t outer = cn_number_begin(), inner = cn_number_begin();
    cn_number_end(inner);
    assert_string_equal(plain(0.5), "0.5");
    cn_number_end(outer);
    assert_string_equal(plain(0.5), "0,5");
}

static void json_keeps_its_dots(void **state)
{
    (void)state;
    char path[64], *text;
    size_t size;
    snprintf(path, sizeof path, "%s/a.json", folder);
    json_t *root = json_pack("{s:f}", "half", 0.5);
    assert_int_equal(cn_json_save(root, path), CN_OK);
    json_decref(root);
    assert_int_equal(cn_file_read(path, 0, &text, &size), CN_OK);
    assert_non_null(strstr(text, "0.5"));
    free(text);
    double half;
    assert_int_equal(cn_json_load(path, &root), CN_OK);
    assert_int_equal(cn_json_number(root, path, "half", &half), CN_OK);
    assert_true(half == 0.5);
    json_decref(root);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(numbers_are_written_with_dots),
        cmocka_unit_test(numbers_are_read_with_dots),
        cmocka_unit_test(a_hash_does_not_go_by_the_locale),
        cmocka_unit_test(pairs_nest),
        cmocka_unit_test(json_keeps_its_dots),
    };
    int failed = 77;
    if (!mkdtemp(folder)) return 1;
    if (set_comma_locale())
        failed = cmocka_run_group_tests(tests, NULL, NULL);
    else
        puts("skipped: there is no locale de_DE.UTF-8, and localedef cannot make it");
    return folder_remove(folder) == 0 ? failed : 1;
}
