#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>

#include <cmocka.h>

#include "base/file.h"
#include "base/json.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char *path_of(const char *name)
{
    const char *parent = getenv("TMPDIR");
    return cn_format("%s/conurb-json-%ld-%s", parent && *parent ? parent : "/tmp", (long)getpid(), name);
}

static json_t *parse(const char *text)
{
    json_t *root = json_loads(text, 0, NULL);
    assert_non_null(root);
    return root;
}

static void values_survive_a_round_trip(void **state)
{
    (void)state;
    const double values[] = { 0.1, -1e-300, 6378137.000000001, 3 };
    char *path = path_of("trip.json");
    json_t *root = json_pack("{s:o, s:o, s:s, s:b}", "values", cn_json_reals(values, 4), "bad", cn_json_real(NAN),
                             "name", "caf\xc3\xa9", "yes", 1);
    assert_non_null(root);
    assert_int_equal(cn_json_save(root, path), CN_OK);
    json_decref(root);
    assert_int_equal(cn_json_load(path, &root), CN_OK);
    double back[4], fallback;
    const char *name;
    bool yes;
    assert_int_equal(cn_json_numbers(root, path, "values", back, 4), CN_OK);
    for (int i = 0; i < 4; i++)
        assert_true(back[i] == values[i]);
    assert_int_equal(cn_json_string(root, path, "name", &name), CN_OK);
    assert_string_equal(name, "caf\xc3\xa9");
    assert_int_equal(cn_json_bool(root, path, "yes", &yes), CN_OK);
    assert_true(yes);
    assert_true(json_is_null(json_object_get(root, "bad")));
    assert_int_equal(cn_json_number_or(root, path, "bad", 7, &fallback), CN_OK);
    assert_true(fallback == 7);
    json_decref(root);
    assert_int_equal(unlink(path), 0);
    free(path);
}

static void bad_files_are_named_with_their_line(void **state)
{
    (void)state;
    char *path = path_of("bad.json");
    json_t *root;
    assert_int_equal(cn_json_load(path, &root), CN_ERR_IO);
    const char *const texts[] = { "{\n\"a\": 1,\n\"b\" 2\n}", "{\n\n\"a\": 1} trailing", "{\n\n\"a\": NaN}", "" };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        assert_int_equal(cn_file_write(path, texts[i], strlen(texts[i])), CN_OK);
        assert_int_equal(cn_json_load(path, &root), CN_ERR_FORMAT);
        assert_null(root);
        assert_non_null(strstr(cn_error_message(), path));
        if (*texts[i]) assert_non_null(strstr(cn_error_message(), "line 3"));
    }
    static const char marked[] = "\xef\xbb\xbf{\"a\": 1}";
    assert_int_equal(cn_file_write(path, marked, sizeof marked - 1), CN_OK);
    assert_int_equal(cn_json_load(path, &root), CN_OK);
    json_decref(root);
    /* Nested deeper than any stack. */
    char *deep = malloc(100000);
    assert_non_null(deep);
    memset(deep, '[', 100000);
    assert_int_equal(cn_file_write(path, deep, 100000), CN_OK);
    assert_int_equal(cn_json_load(path, &root), CN_ERR_FORMAT);
    free(deep);
    assert_int_equal(unlink(path), 0);
    free(path);
}

static void expect_text(const char *part)
{
    assert_non_null(strstr(cn_error_message(), part));
}

static void missing_and_mistyped_members_are_named(void **state)
{
    (void)state;
    json_t *root = parse("{\"n\": \"x\", \"s\": 1, \"a\": [1, \"b\"], \"half\": 1.5, \"huge\": 1e300, \"z\": null}");
    double number, pair[2];
    int64_t whole;
    bool yes;
    const char *text;
    const json_t *array;
    assert_int_equal(cn_json_number(root, "f.json", "gone", &number), CN_ERR_FORMAT);
    expect_text("f.json: \"gone\" is missing");
    assert_int_equal(cn_json_number(root, "f.json", "n", &number), CN_ERR_FORMAT);
    expect_text("f.json: \"n\" must be a number, but is a string");
    assert_int_equal(cn_json_integer(root, "f.json", "half", &whole), CN_ERR_FORMAT);
    expect_text("\"half\" must be a whole number, but is 1.5");
    assert_int_equal(cn_json_integer(root, "f.json", "huge", &whole), CN_ERR_FORMAT);
    assert_int_equal(cn_json_integer(root, "f.json", "n", &whole), CN_ERR_FORMAT);
    assert_int_equal(cn_json_bool(root, "f.json", "s", &yes), CN_ERR_FORMAT);
    assert_int_equal(cn_json_string(root, "f.json", "s", &text), CN_ERR_FORMAT);
    assert_int_equal(cn_json_array(root, "f.json", "s", &array), CN_ERR_FORMAT);
    assert_int_equal(cn_json_numbers(root, "f.json", "a", pair, 2), CN_ERR_FORMAT);
    expect_text("item 1 is a string");
    assert_int_equal(cn_json_numbers(root, "f.json", "a", pair, 1), CN_ERR_FORMAT);
    expect_text("must hold 1 numbers, but holds 2");
    assert_int_equal(cn_json_number(root, "f.json", "z", &number), CN_ERR_FORMAT);
    assert_int_equal(cn_json_number_or(root, "f.json", "n", 1, &number), CN_ERR_FORMAT);
    assert_int_equal(cn_json_array(root, "f.json", "a", &array), CN_OK);
    assert_int_equal(cn_json_number(array, "f.json", "n", &number), CN_ERR_FORMAT);
    expect_text("expected an object with \"n\"");
    assert_int_equal(cn_json_number_or(array, "f.json", "n", 1, &number), CN_ERR_FORMAT);
    json_decref(root);
}

static void whole_reals_are_integers(void **state)
{
    (void)state;
    json_t *root = parse("{\"w\": 1080.0, \"h\": -3, \"f\": 2}");
    int64_t whole;
    double number;
    assert_int_equal(cn_json_integer(root, "f", "w", &whole), CN_OK);
    assert_int_equal(whole, 1080);
    assert_int_equal(cn_json_integer(root, "f", "h", &whole), CN_OK);
    assert_int_equal(whole, -3);
    assert_int_equal(cn_json_number(root, "f", "f", &number), CN_OK);
    assert_true(number == 2);
    json_decref(root);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(values_survive_a_round_trip),
        cmocka_unit_test(bad_files_are_named_with_their_line),
        cmocka_unit_test(missing_and_mistyped_members_are_named),
        cmocka_unit_test(whole_reals_are_integers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
