/* The conurb binary: a thin caller of the library. */
#ifndef CONURB_APP_APP_H
#define CONURB_APP_APP_H
#include "conurb/job.h"

/* Log lines and progress on stderr: one redrawn line on a terminal, plain lines otherwise. */
void cn_app_console(cn_context *ctx);

/* Words after the command. */
typedef struct cn_app_args { int n; char **words; } cn_app_args;

typedef struct cn_app_command {
    const char *name, *summary, *usage; /* usage: options and an example */
    cn_status (*run)(const cn_context *ctx, const cn_app_args *args);
} cn_app_command;
extern const cn_app_command cn_app_commands[];
extern const int cn_app_n_commands;
#endif
