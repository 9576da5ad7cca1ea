/* Templates of jobs, and texts quoted for a shell, for #SBATCH lines and for YAML. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "batch/submit.h"
#include "fake.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const cn_blank blanks[] = { { "city", "'/data/a b'" }, { "cpus", "8" }, { "empty", "" }, { NULL, NULL } };

static void check_fill(const char *template, const char *expected)
{
    char *text;
    assert_int_equal(cn_template_fill(NULL, "slurm.sbatch", template, blanks, &text), CN_OK);
    assert_string_equal(text, expected);
    free(text);
}

static void test_every_placeholder_is_replaced(void **state)
{
    (void)state;
    check_fill("run {{city}} -n {{cpus}}{{cpus}}{{empty}}!\n", "run '/data/a b' -n 88!\n");
    check_fill("{{cpus}}", "8");
    check_fill("no placeholder", "no placeholder");
    check_fill("", "");
}

/* A shell's own braces stay. */
static void test_other_braces_stay(void **state)
{
    (void)state;
    check_fill("${again:-} {one} }} {{cpus}}", "${again:-} {one} }} 8");
    check_fill("{{cpus}} {{never closed", "8 {{never closed");
}

static void test_unknown_placeholder_is_named(void **state)
{
    (void)state;
    char *text = (char *)"not set";
    assert_int_equal(cn_template_fill(NULL, "slurm.sbatch", "{{cpus}} {{colour}}", blanks, &text), CN_ERR_CONFIG);
    assert_non_null(strstr(cn_error_message(), "{{colour}}"));
    assert_non_null(strstr(cn_error_message(), "slurm.sbatch"));
    assert_null(text);
    /* The start of a known name, and a known name with more behind it, are other names. */
    assert_int_equal(cn_template_fill(NULL, "slurm.sbatch", "{{cpu}}", blanks, &text), CN_ERR_CONFIG);
    assert_int_equal(cn_template_fill(NULL, "slurm.sbatch", "{{cpus2}}", blanks, &text), CN_ERR_CONFIG);
    assert_int_equal(cn_template_fill(NULL, "slurm.sbatch", "{{}}", blanks, &text), CN_ERR_CONFIG);
}

static void test_folder_of_the_site(void **state)
{
    (void)state;
    char *text;
    fake_begin();
    assert_int_equal(cn_template_fill(fake_dir(), "slurm.sbatch", "built in", blanks, &text), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), "slurm.sbatch"));
    assert_null(text);
    fake_write("slurm.sbatch", "the site's, {{cpus}}");
    assert_int_equal(cn_template_fill(fake_dir(), "slurm.sbatch", "built in", blanks, &text), CN_OK);
    assert_string_equal(text, "the site's, 8");
    free(text);
    fake_write("slurm.sbatch", "{{where}}");
    assert_int_equal(cn_template_fill(fake_dir(), "slurm.sbatch", "built in", blanks, &text), CN_ERR_CONFIG);
    assert_non_null(strstr(cn_error_message(), fake_dir())); /* the file at fault is the site's */
    fake_end();
}

static const char *const names[] = { "plain",
                                     "two words",
                                     "it's",
                                     "$HOME `id` $(id)",
                                     "a\"b\\c",
                                     "100% %j",
                                     "semi;colon&",
                                     "star*?[a]",
                                     "#comment",
                                     "\xc3\x9c"
                                     "ber",
                                     "-n",
                                     "line\nbreak",
                                     "tab\there",
                                     "",
                                     "''" };

/* A shell gives each word back as it was. */
static void test_a_shell_reads_words_back(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        char *word = cn_shell_word(names[i]), *command = cn_format("printf '%%s.' %s", word), said[64] = "";
        FILE *shell = popen(command, "r");
        assert_non_null(shell);
        const size_t n = fread(said, 1, sizeof said - 1, shell);
        assert_int_equal(pclose(shell), 0);
        assert_true(n == strlen(names[i]) + 1 && strncmp(said, names[i], n - 1) == 0);
        free(command);
        free(word);
    }
}

/* sbatch splits a line at blanks, takes a backslash as a quote and, in names of files, % as a pattern. */
static void test_words_of_sbatch(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        bool file;
        const char *word;
    } cases[] = { { "/data/a b", true, "/data/a\\ b" }, { "it's", false, "it\\'s" },   { "100%", false, "100\\%" },
                  { "100%j", true, "100%%j" },          { "a\\b", false, "a\\\\b" },   { "#1", false, "\\#1" },
                  { "\xc3\x9c", false, "\xc3\x9c" },    { "x_1-2.y", true, "x_1-2.y" } };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char *word = cn_sbatch_word(cases[i].text, cases[i].file);
        assert_string_equal(word, cases[i].word);
        free(word);
    }
}

static void test_strings_of_yaml(void **state)
{
    (void)state;
    char *string = cn_yaml_string("a \"b\" \\c\n\x7f\xc3\x9c");
    assert_string_equal(string, "\"a \\\"b\\\" \\\\c\\x0a\\x7f\xc3\x9c\"");
    free(string);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_every_placeholder_is_replaced),
        cmocka_unit_test(test_other_braces_stay),
        cmocka_unit_test(test_unknown_placeholder_is_named),
        cmocka_unit_test(test_folder_of_the_site),
        cmocka_unit_test(test_a_shell_reads_words_back),
        cmocka_unit_test(test_words_of_sbatch),
        cmocka_unit_test(test_strings_of_yaml),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
