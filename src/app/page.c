/* `--view` of train and run: starts `conurb view` as a second process. */
#include "app.h"

#include <errno.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>

extern char **environ;

cn_status cn_app_page_start(const cn_app_call *call, pid_t *page)
{
    char self[] = "/proc/self/exe", name[] = "conurb", verb[] = "view", follow[] = "--follow";
    char share[] = "--share", half[] = "0.5", device[] = "--device";
    char *argv[] = { name,  verb, (char *)call->operands[0],    follow,
                     share, half, call->device ? device : NULL, (char *)call->device,
                     NULL };
    const int error = posix_spawn(page, self, NULL, NULL, argv, environ);
    return error ? cn_fail(CN_ERR_TOOL, "the page cannot be started: %s", strerror(error)) : CN_OK;
}

/* Whether the process has ended. */
static bool ended(pid_t page)
{
    int status;
    const pid_t got = waitpid(page, &status, WNOHANG);
    return got == page || (got < 0 && errno != EINTR);
}

void cn_app_page_end(const cn_context *ctx, pid_t page, bool stay)
{
    const struct timespec pause = { .tv_nsec = 100000000 };
    if (stay && !cn_stopping(ctx) && !ended(page)) fprintf(stderr, "done; the page stays open until Ctrl-C\n");
    bool gone = ended(page);
    while (stay && !gone && !cn_stopping(ctx)) {
        nanosleep(&pause, NULL);
        gone = ended(page);
    }
    if (gone) return;
    kill(page, SIGTERM);
    while (!ended(page))
        nanosleep(&pause, NULL);
}
