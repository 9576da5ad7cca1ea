#include "base/process.h"

#include "base/clock.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#define POLL_MS 200
#define PATIENCE_S 10
#define QT_PLATFORM "QT_QPA_PLATFORM"

extern char **environ;

typedef struct pump {
    FILE *log;
    cn_line_function on_line;
    void *user;
    char line[4096];
    size_t n;
} pump;

/* The environment with a Qt platform that needs no display, and with a locale whose numbers have dots: Qt sets the
 * locale of the environment, and COLMAP then reads and writes its numbers by it. Entries are borrowed; the list is
 * malloc'ed. */
static char **make_environment(void)
{
    size_t n = 0, kept = 0;
    while (environ[n])
        n++;
    char **list = malloc((n + 3) * sizeof *list);
    if (!list) return NULL;
    for (size_t i = 0; i < n; i++)
        if (strncmp(environ[i], QT_PLATFORM "=", sizeof QT_PLATFORM) != 0 && strncmp(environ[i], "LC_ALL=", 7) != 0)
            list[kept++] = environ[i];
    static char offscreen[] = QT_PLATFORM "=offscreen", dots[] = "LC_ALL=C.UTF-8";
    list[kept++] = offscreen;
    list[kept++] = dots;
    list[kept] = NULL;
    return list;
}

/* A process group of its own, so that Ctrl-C reaches the caller, who then stops the child in order. */
static int spawn(const char *const *argv, int output, char **environment, pid_t *pid)
{
    posix_spawn_file_actions_t files;
    posix_spawnattr_t attributes;
    sigset_t none, usual;
    sigemptyset(&none);
    sigemptyset(&usual);
    sigaddset(&usual, SIGINT);
    sigaddset(&usual, SIGTERM);
    sigaddset(&usual, SIGPIPE);
    int error = posix_spawn_file_actions_init(&files);
    if (error) return error;
    error = posix_spawnattr_init(&attributes);
    if (!error) {
        posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
        posix_spawnattr_setpgroup(&attributes, 0);
        posix_spawnattr_setsigmask(&attributes, &none);
        posix_spawnattr_setsigdefault(&attributes, &usual);
        error = posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
        if (!error) error = posix_spawn_file_actions_adddup2(&files, output, STDOUT_FILENO);
        if (!error) error = posix_spawn_file_actions_adddup2(&files, output, STDERR_FILENO);
        /* exec does not change the strings; the type is older than const. */
        char *const *words = (char *const *)(uintptr_t)argv;
        if (!error) error = posix_spawnp(pid, argv[0], &files, &attributes, words, environment);
        posix_spawnattr_destroy(&attributes);
    }
    posix_spawn_file_actions_destroy(&files);
    return error;
}

static void feed(pump *to, const char *data, size_t n)
{
    fwrite(data, 1, n, to->log);
    for (size_t i = 0; i < n; i++) {
        bool ends = data[i] == '\n' || data[i] == '\r';
        if (!ends) to->line[to->n++] = data[i];
        if (to->n && (ends || to->n == sizeof to->line - 1)) {
            to->line[to->n] = '\0';
            to->on_line(to->user, to->line);
            to->n = 0;
        }
    }
}

/* Reads until the program closes its output. True when it was asked to stop. */
static bool listen_to(const cn_context *ctx, int input, pid_t pid, pump *to)
{
    char data[4096];
    bool stopping = false;
    double deadline = 0.0;
    for (;;) {
        struct pollfd wait = { .fd = input, .events = POLLIN };
        int ready = poll(&wait, 1, POLL_MS);
        if (!stopping && cn_stopping(ctx)) {
            stopping = true;
            deadline = cn_now_s() + PATIENCE_S;
            kill(-pid, SIGTERM);
        }
        if (stopping && cn_now_s() > deadline) {
            kill(-pid, SIGKILL);
            break;
        }
        if (ready <= 0) continue;
        ssize_t n = read(input, data, sizeof data);
        if (n > 0)
            feed(to, data, (size_t)n);
        else if (n == 0 || errno != EINTR)
            break;
    }
    feed(to, "\n", 1);
    return stopping;
}

static int wait_for(pid_t pid)
{
    int state;
    while (waitpid(pid, &state, 0) < 0)
        if (errno != EINTR) return 127;
    return WIFEXITED(state) ? WEXITSTATUS(state) : 128 + WTERMSIG(state);
}

static cn_status run(const cn_context *ctx, const char *const *argv, pump *to, int *exit_code)
{
    int ends[2];
    pid_t pid;
    if (pipe2(ends, O_CLOEXEC) != 0) return cn_fail(CN_ERR_IO, "cannot make a pipe: %s", strerror(errno));
    char **environment = make_environment();
    int error = environment ? spawn(argv, ends[1], environment, &pid) : ENOMEM;
    close(ends[1]);
    free(environment);
    if (error) {
        close(ends[0]);
        return cn_fail(CN_ERR_TOOL, "cannot run %s: %s", argv[0], strerror(error));
    }
    bool stopped = listen_to(ctx, ends[0], pid, to);
    close(ends[0]);
    *exit_code = wait_for(pid);
    return stopped ? cn_fail(CN_ERR_INTERRUPTED, "stopped while %s ran", argv[0]) : CN_OK;
}

cn_status cn_process_run(const cn_context *ctx, const char *const *argv, const char *log_path, cn_line_function on_line,
                         void *user, int *exit_code)
{
    pump to = { .on_line = on_line, .user = user };
    *exit_code = 0;
    to.log = fopen(log_path, "ae");
    if (!to.log) return cn_fail(CN_ERR_IO, "%s: cannot write the log: %s", log_path, strerror(errno));
    fputs("\n$", to.log);
    for (size_t i = 0; argv[i]; i++)
        fprintf(to.log, " %s", argv[i]);
    fputs("\n", to.log);
    fflush(to.log);
    cn_status status = run(ctx, argv, &to, exit_code);
    fclose(to.log);
    return status;
}
