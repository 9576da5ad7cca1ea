/* Running a program and reading what it says. */
#ifndef CONURB_BASE_PROCESS_H
#define CONURB_BASE_PROCESS_H
#include "conurb/base.h"

/* Called with each line that the program prints, without its end. */
typedef void (*cn_line_function)(void *user, char *line);
/* Runs argv (NULL-terminated; argv[0] is looked up in PATH, no shell) with its output appended to log_path and handed
 * to on_line. ctx->stop ends it (SIGTERM, after 10 s SIGKILL): CN_ERR_INTERRUPTED. CN_ERR_TOOL when it cannot be
 * started. *exit_code: its exit status, 128 + the signal when killed. */
CN_NODISCARD cn_status cn_process_run(const cn_context *ctx, const char *const *argv, const char *log_path,
                                      cn_line_function on_line, void *user, int *exit_code);
#endif
