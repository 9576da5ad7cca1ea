#include "base/lock.h"

#include "base/file.h"

#include <fcntl.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>

static char folder[] = "/tmp/conurb-lock-XXXXXX";
static char path[64];

static int set_up(void **state)
{
    (void)state;
    if (!mkdtemp(folder)) return -1;
    snprintf(path, sizeof path, "%s/LOCK", folder);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    return rmdir(folder); /* fails when a lock was left behind */
}

/* What a killed process of one user leaves, another of the group can take over where the umask lets the group write. */
static void the_umask_decides_who_may_write(void **state)
{
    (void)state;
    static const mode_t masks[] = { 0002, 0022, 0077 };
    for (size_t i = 0; i < sizeof masks / sizeof *masks; i++) {
        cn_lock *lock;
        struct stat info;
        const mode_t before = umask(masks[i]);
        const cn_status status = cn_lock_take(&lock, path, "tile A");
        umask(before);
        assert_int_equal(status, CN_OK);
        const int looked = stat(path, &info);
        cn_lock_release(&lock); /* before a failure, so that the other tests get it */
        assert_int_equal(looked, 0);
        assert_int_equal(info.st_mode & 0777, 0666 & ~masks[i]);
    }
}

static void one_holder_at_a_time(void **state)
{
    (void)state;
    cn_lock *first = NULL, *second = NULL;
    cn_lock_state seen;
    cn_lock_look(path, &seen);
    assert_false(seen.there);
    assert_int_equal(cn_lock_take(&first, path, "tile A"), CN_OK);
    assert_int_equal(cn_lock_take(&second, path, "tile A"), CN_ERR_LOCKED);
    assert_null(second);
    assert_non_null(strstr(cn_error_message(), "tile A"));
    char pid[32];
    snprintf(pid, sizeof pid, "process %ld", (long)getpid());
    assert_non_null(strstr(cn_error_message(), pid));
    cn_lock_look(path, &seen);
    assert_true(seen.there && seen.held);
    assert_int_equal(seen.pid, getpid());
    assert_true(seen.age_s < 5);
    cn_lock_release(&first);
    assert_false(cn_file_exists(path));
    assert_int_equal(cn_lock_take(&first, path, "tile A"), CN_OK);
    cn_lock_release(&first);
    cn_lock_release(&first);
}

/* A process that holds the lock until it is killed. */
static pid_t holder(void)
{
    int ready[2];
    char byte = 0;
    assert_int_equal(pipe(ready), 0);
    const pid_t pid = fork();
    if (pid == 0) {
        cn_lock *lock;
        if (cn_lock_take(&lock, path, "tile A") != CN_OK) _exit(1);
        if (write(ready[1], "r", 1) != 1) _exit(1);
        for (;;)
            pause();
    }
    assert_int_equal(read(ready[0], &byte, 1), 1);
    close(ready[0]);
    close(ready[1]);
    return pid;
}

static void a_dead_holder_keeps_nobody_out(void **state)
{
    (void)state;
    cn_lock *mine = NULL;
    cn_lock_state seen;
    const pid_t pid = holder();
    assert_int_equal(cn_lock_take(&mine, path, "tile A"), CN_ERR_LOCKED);
    kill(pid, SIGKILL);
    waitpid(pid, NULL, 0);
    cn_lock_look(path, &seen);
    assert_true(seen.there);
    assert_false(seen.held);
    assert_int_equal(seen.pid, pid);
    assert_int_equal(cn_lock_take(&mine, path, "tile A"), CN_OK);
    cn_lock_release(&mine);
}

/* The file of another machine's process, on a file system that does not pass on its locks. */
static void leave(const char *text, time_t age_s)
{
    FILE *stream = fopen(path, "w");
    assert_non_null(stream);
    fputs(text, stream);
    fclose(stream);
    const struct timespec then[2] = { { .tv_sec = time(NULL) - age_s }, { .tv_sec = time(NULL) - age_s } };
    assert_int_equal(utimensat(AT_FDCWD, path, then, 0), 0);
}

static void another_machine_counts_until_it_is_silent(void **state)
{
    (void)state;
    cn_lock *mine = NULL;
    cn_lock_state seen;
    leave("elsewhere 42\n{\"step\":7}\n", 10);
    assert_int_equal(cn_lock_take(&mine, path, "tile A"), CN_ERR_LOCKED);
    assert_non_null(strstr(cn_error_message(), "process 42 on elsewhere"));
    cn_lock_look(path, &seen);
    assert_true(seen.held);
    assert_string_equal(seen.note, "{\"step\":7}");
    leave("elsewhere 42\n\n", CN_LOCK_STALE_S + 2);
    cn_lock_look(path, &seen);
    assert_false(seen.held);
    assert_int_equal(cn_lock_take(&mine, path, "tile A"), CN_OK);
    cn_lock_release(&mine);
    /* A truncated lock file belongs to nobody. */
    leave("\0", 0);
    assert_int_equal(cn_lock_take(&mine, path, "tile A"), CN_OK);
    cn_lock_release(&mine);
}

static void a_folder_that_is_missing_is_named(void **state)
{
    (void)state;
    cn_lock *lock = NULL;
    assert_int_equal(cn_lock_take(&lock, "/nowhere/at/all/LOCK", "x"), CN_ERR_IO);
    assert_non_null(strstr(cn_error_message(), "/nowhere/at/all/LOCK"));
}

/* Many processes compete for the lock. The counter shows that two never hold it together. */
static void a_crowd_takes_turns(void **state)
{
#ifdef __SANITIZE_THREAD__
    (void)state;
    print_message("skipped: ThreadSanitizer does not follow threads that are started after a fork\n");
    skip();
#endif
    (void)state;
    enum { CROWD = 8, TURNS = 40 };
    pid_t pids[CROWD];
    char inside[80];
    snprintf(inside, sizeof inside, "%s/inside", folder);
    for (int i = 0; i < CROWD; i++)
        if ((pids[i] = fork()) == 0) {
            for (int turn = 0; turn < TURNS;) {
                cn_lock *lock = NULL;
                if (cn_lock_take(&lock, path, "x") != CN_OK) continue;
                if (mkdir(inside, 0700) != 0) _exit(1);
                if (rmdir(inside) != 0) _exit(2);
                cn_lock_release(&lock);
                turn++;
            }
            _exit(0);
        }
    for (int i = 0; i < CROWD; i++) {
        int result = -1;
        waitpid(pids[i], &result, 0);
        assert_int_equal(result, 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_holder_at_a_time),
        cmocka_unit_test(the_umask_decides_who_may_write),
        cmocka_unit_test(a_dead_holder_keeps_nobody_out),
        cmocka_unit_test(another_machine_counts_until_it_is_silent),
        cmocka_unit_test(a_folder_that_is_missing_is_named),
        cmocka_unit_test(a_crowd_takes_turns),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
