/* Runs a program and reads its output. */
#ifndef CONURB_BASE_PROCESS_H
#define CONURB_BASE_PROCESS_H
#include "conurb/base.h"

/* Called with each line that the program prints, without its end. */
typedef void (*cn_line_function)(void *user, char *line);

typedef struct cn_process {
    const char *const *argv; /* NULL-terminated; argv[0] is looked up in PATH, no shell */
    const char *log_path;    /* the output is appended to it */
    const char *note_path;   /* names the program while it runs, for cn_process_end_stray; NULL: no note */
    cn_line_function on_line;
    void (*on_wait)(void *user); /* called a few times per second while the program runs; NULL: never */
    void *user;                  /* handed to both */
    double limit_s;              /* the program is ended when it runs for longer; 0: no limit */
} cn_process;

/* Runs the program to its end. ctx->stop ends it and its process group (SIGTERM, after 10 s SIGKILL):
 * CN_ERR_INTERRUPTED. It is killed when the calling thread ends without that, by kill -9 for instance. CN_ERR_TOOL when
 * it cannot be started, or runs for longer than limit_s. *exit_code: its exit status, 128 + the signal when killed. */
CN_NODISCARD cn_status cn_process_watch(const cn_context *ctx, const cn_process *process, int *exit_code);
/* The same with neither note nor on_wait. */
CN_NODISCARD cn_status cn_process_run(const cn_context *ctx, const char *const *argv, const char *log_path,
                                      cn_line_function on_line, void *user, int *exit_code);
/* Ends a program that a killed run left behind: the one that a note of cn_process_watch names, if it still runs.
 * Returns when it has ended, and removes the note. CN_ERR_LOCKED: it cannot be ended. */
CN_NODISCARD cn_status cn_process_end_stray(const cn_context *ctx, const char *note_path);
#endif
