#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/process.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

static char folder[64], note[96], log_path[96], pid_path[96], script[512];
static char heard[256];
static int n_waits, stop;

static int set_up(void **state)
{
    (void)state;
    strcpy(folder, "/tmp/conurb-process-XXXXXX");
    if (!mkdtemp(folder)) return -1;
    snprintf(note, sizeof note, "%s/note", folder);
    snprintf(log_path, sizeof log_path, "%s/log", folder);
    snprintf(pid_path, sizeof pid_path, "%s/pid", folder);
    snprintf(script, sizeof script, "echo $$ >%s.new; mv %s.new %s; exec sleep 1000", pid_path, pid_path, pid_path);
    heard[0] = '\0';
    n_waits = stop = 0;
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    unlink(note);
    unlink(log_path);
    unlink(pid_path);
    return rmdir(folder);
}

static void hear(void *user, char *line)
{
    (void)user;
    snprintf(heard + strlen(heard), sizeof heard - strlen(heard), "%s;", line);
}

static void count_waits(void *user)
{
    (void)user;
    n_waits++;
}

/* The number that the script wrote. */
static pid_t written_pid(void)
{
    char *text = NULL;
    size_t size;
    while (!cn_file_exists(pid_path))
        poll(NULL, 0, 5);
    assert_int_equal(cn_file_read(pid_path, 0, &text, &size), CN_OK);
    const pid_t pid = (pid_t)strtol(text, NULL, 10);
    free(text);
    assert_true(pid > 1);
    return pid;
}

/* Whether the process has ended, or is a zombie. */
static bool gone(pid_t pid)
{
    char path[64], text[512] = "";
    snprintf(path, sizeof path, "/proc/%ld/stat", (long)pid);
    FILE *stream = fopen(path, "r");
    if (!stream) return true;
    const bool read = fgets(text, sizeof text, stream) != NULL;
    fclose(stream);
    return !read || strstr(text, ") Z ");
}

/* The time limit of ctest ends an endless wait. */
static void wait_until_gone(pid_t pid)
{
    while (!gone(pid))
        poll(NULL, 0, 5);
}

static void test_run(void **state)
{
    (void)state;
    int code;
    const char *const argv[] = { "sh", "-c", "echo one; echo two >&2; exit 7", NULL };
    const cn_process process = {
        .argv = argv, .log_path = log_path, .note_path = note, .on_line = hear, .on_wait = count_waits
    };
    assert_int_equal(cn_process_watch(NULL, &process, &code), CN_OK);
    assert_int_equal(code, 7);
    assert_string_equal(heard, "one;two;");
    assert_true(n_waits > 0);
    assert_false(cn_file_exists(note));
    const char *const killed[] = { "sh", "-c", "kill -9 $$", NULL };
    assert_int_equal(cn_process_run(NULL, killed, log_path, hear, NULL, &code), CN_OK);
    assert_int_equal(code, 128 + 9);
}

static void test_not_there(void **state)
{
    (void)state;
    int code;
    const char *const argv[] = { "/nonexistent/program", NULL };
    assert_int_equal(cn_process_run(NULL, argv, log_path, hear, NULL, &code), CN_ERR_TOOL);
    assert_non_null(strstr(cn_error_message(), "/nonexistent/program"));
    assert_non_null(strstr(cn_error_message(), strerror(ENOENT)));
}

/* A program that does not answer is ended at its limit, and its caller goes on. */
static void test_limit(void **state)
{
    (void)state;
    int code;
    const char *const argv[] = { "sh", "-c", script, NULL };
    const cn_process process = { .argv = argv, .log_path = log_path, .on_line = hear, .limit_s = 0.5 };
    assert_int_equal(cn_process_watch(NULL, &process, &code), CN_ERR_TOOL);
    assert_non_null(strstr(cn_error_message(), "did not end within"));
    wait_until_gone(written_pid());
}

static void stop_now(void *user)
{
    (void)user;
    if (cn_file_exists(pid_path)) cn_stop(&stop);
}

/* Child processes of the program end too. */
static void test_stop_ends_the_group(void **state)
{
    (void)state;
    int code;
    char text[600];
    snprintf(text, sizeof text, "(%s) & wait", script);
    const char *const argv[] = { "sh", "-c", text, NULL };
    const cn_context ctx = { .stop = &stop };
    const cn_process process = { .argv = argv, .log_path = log_path, .on_line = hear, .on_wait = stop_now };
    assert_int_equal(cn_process_watch(&ctx, &process, &code), CN_ERR_INTERRUPTED);
    assert_int_equal(code, 128 + SIGTERM);
    wait_until_gone(written_pid());
}

/* A run in a process of its own, which is killed when its program runs. Returns the program. */
static pid_t killed_run(const char *note_path)
{
    const char *const argv[] = { "sh", "-c", script, NULL };
    const pid_t runner = fork();
    assert_true(runner >= 0);
    if (runner == 0) {
        int code;
        const cn_process process = { .argv = argv, .log_path = log_path, .note_path = note_path, .on_line = hear };
        _exit((int)cn_process_watch(NULL, &process, &code));
    }
    const pid_t program = written_pid();
    while (note_path && !cn_file_exists(note_path))
        poll(NULL, 0, 5);
    assert_int_equal(kill(runner, SIGKILL), 0);
    assert_int_equal(waitpid(runner, NULL, 0), runner);
    return program;
}

static void test_dies_with_its_parent(void **state)
{
    (void)state;
    wait_until_gone(killed_run(NULL));
}

static void note_for(pid_t pid, int later)
{
    char path[64], text[512] = "", boot[64], line[160];
    unsigned long long start = 0;
    snprintf(path, sizeof path, "/proc/%ld/stat", (long)pid);
    FILE *stream = fopen(path, "r");
    assert_non_null(stream);
    assert_non_null(fgets(text, sizeof text, stream));
    fclose(stream);
    char *at = strrchr(text, ')') + 2;
    for (int i = 3; i < 22; i++)
        at = strchr(at, ' ') + 1;
    start = strtoull(at, NULL, 10);
    stream = fopen("/proc/sys/kernel/random/boot_id", "r");
    assert_non_null(stream);
    assert_int_equal(fscanf(stream, "%63s", boot), 1);
    fclose(stream);
    const int n = snprintf(line, sizeof line, "%s %ld %llu\n", boot, (long)pid, start + (unsigned)later);
    assert_int_equal(cn_file_write(note, line, (size_t)n), CN_OK);
}

/* A program that outlived its parent is ended by its note, but not another process that now has its number. */
static void test_stray(void **state)
{
    (void)state;
    const pid_t stray = fork();
    assert_true(stray >= 0);
    if (stray == 0) {
        setpgid(0, 0);
        signal(SIGTERM, SIG_DFL);
        for (;;)
            pause();
    }
    assert_int_equal(cn_process_end_stray(NULL, note), CN_OK); /* no note */
    note_for(stray, 1);
    assert_int_equal(cn_process_end_stray(NULL, note), CN_OK);
    assert_false(gone(stray));
    assert_false(cn_file_exists(note));
    note_for(stray, 0);
    assert_int_equal(cn_process_end_stray(NULL, note), CN_OK);
    assert_true(gone(stray));
    assert_false(cn_file_exists(note));
    assert_int_equal(waitpid(stray, NULL, 0), stray);
    assert_int_equal(cn_file_write(note, "nonsense", 8), CN_OK);
    assert_int_equal(cn_process_end_stray(NULL, note), CN_OK);
}

/* The note of a killed run names a program that died with it. */
static void test_note_of_a_killed_run(void **state)
{
    (void)state;
    const pid_t program = killed_run(note);
    assert_true(cn_file_exists(note));
    assert_int_equal(cn_process_end_stray(NULL, note), CN_OK);
    wait_until_gone(program);
    assert_false(cn_file_exists(note));
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_run),
        TEST(test_limit),
        TEST(test_not_there),
        TEST(test_stop_ends_the_group),
        TEST(test_dies_with_its_parent),
        TEST(test_stray),
        TEST(test_note_of_a_killed_run),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
