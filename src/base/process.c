#include "base/process.h"

#include "base/clock.h"
#include "base/file.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#define POLL_MS 200
#define PATIENCE_S 10
#define QT_PLATFORM "QT_QPA_PLATFORM"

extern char **environ;

typedef struct pump {
    FILE *log;
    const cn_process *process;
    char line[4096];
    size_t n;
} pump;

/* The environment with a Qt platform that needs no display, and with a locale whose numbers have dots: Qt sets the
 * locale of the environment, and COLMAP then reads and writes its numbers by it. The entries are borrowed; the caller
 * frees the list. */
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

/* In the child, between fork and exec: only what is safe there. The child gets a process group of its own: Ctrl-C
 * reaches only the caller, who then stops the child. It is killed when the caller's thread ends in any way. */
static void become(const char *const *argv, int output, char **environment, pid_t parent)
{
    static const int USUAL[] = { SIGHUP, SIGINT, SIGTERM, SIGPIPE };
    sigset_t none;
    for (size_t i = 0; i < sizeof USUAL / sizeof *USUAL; i++)
        signal(USUAL[i], SIG_DFL);
    if (setpgid(0, 0) != 0 || prctl(PR_SET_PDEATHSIG, SIGKILL) != 0) return;
    /* The parent may have died before the line above. */
    if (getppid() != parent) _exit(127);
    const int nothing = open("/dev/null", O_RDONLY);
    if (nothing < 0 || dup2(nothing, STDIN_FILENO) < 0) return;
    if (dup2(output, STDOUT_FILENO) < 0 || dup2(output, STDERR_FILENO) < 0) return;
    if (nothing > STDERR_FILENO) close(nothing);
    sigemptyset(&none);
    pthread_sigmask(SIG_SETMASK, &none, NULL);
    /* exec does not change the strings; the type is older than const. */
    execvpe(argv[0], (char *const *)(uintptr_t)argv, environment);
}

/* Returns the errno of a failure, also of one in the child: a successful exec closes the pipe `report`. Signals are
 * blocked meanwhile, so that no handler of the caller runs in the child. */
static int spawn(const char *const *argv, int output, char **environment, pid_t *pid)
{
    int report[2], error = 0;
    sigset_t all, before;
    if (pipe2(report, O_CLOEXEC) != 0) return errno;
    const pid_t parent = getpid();
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    /* Not fork: in the child it runs the handlers of libraries, and PROJ's waits for a lock that another thread may
     * have held. The child has no such thread, so it would wait for ever. */
    *pid = _Fork();
    if (*pid == 0) {
        become(argv, output, environment, parent);
        error = errno;
        /* If this fails too, the parent sees a program without output that ends with 127. */
        _exit(write(report[1], &error, sizeof error) == sizeof error ? 127 : 126);
    }
    if (*pid < 0) error = errno;
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    close(report[1]);
    ssize_t n = 0;
    while (*pid > 0 && (n = read(report[0], &error, sizeof error)) < 0 && errno == EINTR)
        ;
    close(report[0]);
    if (*pid > 0 && n == sizeof error)
        while (waitpid(*pid, NULL, 0) < 0 && errno == EINTR)
            ;
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
            to->process->on_line(to->process->user, to->line);
            to->n = 0;
        }
    }
}

typedef enum ending {
    ENDED,     /* it closed its output */
    STOPPED,   /* the caller asked to stop */
    TIMED_OUT, /* it ran for longer than its limit */
} ending;

/* Reads until the program closes its output. */
static ending listen_to(const cn_context *ctx, int input, pid_t pid, pump *to)
{
    char data[4096];
    ending how = ENDED;
    double deadline = 0.0;
    const double limit_s = to->process->limit_s, begun = cn_now_s();
    for (;;) {
        struct pollfd wait = { .fd = input, .events = POLLIN };
        int ready = poll(&wait, 1, POLL_MS);
        if (to->process->on_wait) to->process->on_wait(to->process->user);
        if (how == ENDED && (cn_stopping(ctx) || (limit_s > 0.0 && cn_now_s() - begun > limit_s))) {
            how = cn_stopping(ctx) ? STOPPED : TIMED_OUT;
            deadline = cn_now_s() + PATIENCE_S;
            kill(-pid, SIGTERM);
        }
        if (how != ENDED && cn_now_s() > deadline) {
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
    return how;
}

static int wait_for(pid_t pid)
{
    int state;
    while (waitpid(pid, &state, 0) < 0)
        if (errno != EINTR) return 127;
    return WIFEXITED(state) ? WEXITSTATUS(state) : 128 + WTERMSIG(state);
}

/* Start time of a process, in ticks since boot; 0 when there is no such process, or only a zombie. */
static unsigned long long start_of(pid_t pid)
{
    char path[64], text[1024], state = 'Z';
    unsigned long long start = 0;
    snprintf(path, sizeof path, "/proc/%ld/stat", (long)pid);
    FILE *stream = fopen(path, "re");
    if (!stream) return 0;
    const size_t n = fread(text, 1, sizeof text - 1, stream);
    fclose(stream);
    text[n] = '\0';
    /* The name, in brackets, may contain any character. */
    const char *rest = strrchr(text, ')');
    if (!rest || sscanf(rest + 1, " %c %*s %*s %*s %*s %*s %*s %*s %*s %*s %*s %*s %*s %*s %*s %*s %*s %*s %*s %llu",
                        &state, &start) != 2)
        return 0;
    return state == 'Z' || state == 'X' ? 0 : start;
}

/* Identifies this boot of this machine: process numbers are valid only within it. */
static void boot_name(char out[64])
{
    FILE *stream = fopen("/proc/sys/kernel/random/boot_id", "re");
    if (!stream || fscanf(stream, "%63s", out) != 1) strcpy(out, "unknown");
    if (stream) fclose(stream);
}

static cn_status write_note(const char *path, pid_t pid)
{
    char boot[64], text[160];
    boot_name(boot);
    const int n = snprintf(text, sizeof text, "%s %ld %llu\n", boot, (long)pid, start_of(pid));
    return cn_file_write(path, text, (size_t)n);
}

/* The process that the note names, if it lives; 0 otherwise. */
static pid_t read_note(const char *path)
{
    char boot[64], here[64];
    long pid = 0;
    unsigned long long start = 0;
    FILE *stream = fopen(path, "re");
    if (!stream) return 0;
    const bool whole = fscanf(stream, "%63s %ld %llu", boot, &pid, &start) == 3;
    fclose(stream);
    boot_name(here);
    if (!whole || pid <= 1 || !start || strcmp(boot, here) != 0) return 0;
    return start_of((pid_t)pid) == start ? (pid_t)pid : 0;
}

cn_status cn_process_end_stray(const cn_context *ctx, const char *note_path)
{
    const pid_t pid = read_note(note_path);
    if (pid) {
        cn_log(ctx, CN_LOG_WARN, "process %ld is left from a killed run; ending it", (long)pid);
        const double begun = cn_now_s();
        for (int signal_sent = 0; read_note(note_path) == pid;) {
            const double waited_s = cn_now_s() - begun;
            const int next = waited_s < PATIENCE_S ? SIGTERM : SIGKILL;
            if (next != signal_sent && kill(-pid, next) != 0 && kill(pid, next) != 0 && errno != ESRCH)
                return cn_fail(CN_ERR_LOCKED,
                               "process %ld, left from a killed run, cannot be ended: %s; end it yourself", (long)pid,
                               strerror(errno));
            signal_sent = next;
            if (waited_s > 2 * PATIENCE_S)
                return cn_fail(CN_ERR_LOCKED, "process %ld, left from a killed run, does not end; end it yourself",
                               (long)pid);
            poll(NULL, 0, 20);
        }
    }
    return cn_file_remove(note_path);
}

static cn_status run(const cn_context *ctx, pump *to, int *exit_code)
{
    const cn_process *process = to->process;
    int ends[2];
    pid_t pid = -1;
    if (pipe2(ends, O_CLOEXEC) != 0) return cn_fail(CN_ERR_IO, "cannot make a pipe: %s", strerror(errno));
    char **environment = make_environment();
    int error = environment ? spawn(process->argv, ends[1], environment, &pid) : ENOMEM;
    close(ends[1]);
    free(environment);
    if (error) {
        close(ends[0]);
        return cn_fail(CN_ERR_TOOL, "cannot run %s: %s", process->argv[0], strerror(error));
    }
    cn_status status = process->note_path ? write_note(process->note_path, pid) : CN_OK;
    ending how = ENDED;
    if (status == CN_OK)
        how = listen_to(ctx, ends[0], pid, to);
    else
        kill(-pid, SIGKILL);
    close(ends[0]);
    *exit_code = wait_for(pid);
    if (status == CN_OK && process->note_path) status = cn_file_remove(process->note_path);
    CN_TRY(status);
    if (how == TIMED_OUT)
        return cn_fail(CN_ERR_TOOL, "%s did not end within %.0f s", process->argv[0], process->limit_s);
    return how == STOPPED ? cn_fail(CN_ERR_INTERRUPTED, "stopped while %s ran", process->argv[0]) : CN_OK;
}

cn_status cn_process_watch(const cn_context *ctx, const cn_process *process, int *exit_code)
{
    pump to = { .process = process };
    *exit_code = 0;
    to.log = fopen(process->log_path, "ae");
    if (!to.log) return cn_fail(CN_ERR_IO, "%s: cannot write the log: %s", process->log_path, strerror(errno));
    fputs("\n$", to.log);
    for (size_t i = 0; process->argv[i]; i++)
        fprintf(to.log, " %s", process->argv[i]);
    fputs("\n", to.log);
    fflush(to.log);
    cn_status status = run(ctx, &to, exit_code);
    fclose(to.log);
    return status;
}

cn_status cn_process_run(const cn_context *ctx, const char *const *argv, const char *log_path, cn_line_function on_line,
                         void *user, int *exit_code)
{
    const cn_process process = { .argv = argv, .log_path = log_path, .on_line = on_line, .user = user };
    return cn_process_watch(ctx, &process, exit_code);
}
