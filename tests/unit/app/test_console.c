#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "app/app.h"

#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* drawn(done, total, n, percent): n of '#', then '.', and nothing written past the end. */
static void drawn(double done, double total, size_t n, int percent)
{
    char room[CN_APP_BAR + 3];
    memset(room, 'x', sizeof room);
    assert_int_equal(cn_app_bar(done, total, room + 1), percent);
    assert_int_equal(strspn(room + 1, "#"), n);
    assert_int_equal(strspn(room + 1 + n, "."), CN_APP_BAR - n);
    assert_int_equal(room[CN_APP_BAR + 1], '\0');
    assert_true(room[0] == 'x' && room[CN_APP_BAR + 2] == 'x');
}

static void test_bar(void **state)
{
    (void)state;
    drawn(0, 10, 0, 0);
    drawn(1, 10, 2, 10);
    drawn(9.99, 10, 19, 99);
    drawn(10, 10, 20, 100);
    drawn(3, 0, 0, 0); /* the total is not known */
}

/* COLMAP's output decides how much is done. A fraction above 1 was once written past the end of the bar. */
static void test_bar_beyond_its_ends(void **state)
{
    (void)state;
    drawn(11, 10, 20, 100);
    drawn(4294967295.0, 1, 20, 100);
    drawn(INFINITY, 1, 20, 100);
    drawn(-5, 10, 0, 0);
    drawn(NAN, 10, 0, 0);
    drawn(5, NAN, 0, 0);
    drawn(5, INFINITY, 0, 0);
}

/* The line on the terminal for a progress report. */
static void line_of(const cn_progress_report *report, char text[512])
{
    const int master = posix_openpt(O_RDWR | O_NOCTTY);
    if (master < 0 || grantpt(master) != 0 || unlockpt(master) != 0) skip();
    const int terminal = open(ptsname(master), O_RDWR | O_NOCTTY), before = dup(STDERR_FILENO);
    assert_true(terminal >= 0 && before >= 0 && dup2(terminal, STDERR_FILENO) >= 0);
    cn_context ctx = { 0 };
    cn_app_console(&ctx);
    cn_progress(&ctx, report);
    assert_true(dup2(before, STDERR_FILENO) >= 0);
    const ssize_t n = read(master, text, 511);
    assert_true(n > 0);
    text[n] = 0;
    close(terminal);
    close(master);
    close(before);
}

static void test_line_on_a_terminal(void **state)
{
    (void)state;
    char text[512];
    line_of(&(cn_progress_report){ "matches", NULL, 700, 7, 1, 0, NULL }, text);
    assert_non_null(strstr(text, "[####################] 100%"));
    /* The total is not known yet. */
    line_of(&(cn_progress_report){ "train", "A", 8, 0, 1, -1, NULL }, text);
    assert_non_null(strstr(text, "8, ? left"));
    assert_null(strstr(text, "of 0"));
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_bar), cmocka_unit_test(test_bar_beyond_its_ends),
                                        cmocka_unit_test(test_line_on_a_terminal) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
