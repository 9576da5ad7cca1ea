/* The conurb binary: a thin caller of the library. */
#ifndef CONURB_APP_APP_H
#define CONURB_APP_APP_H
#include "conurb/stage.h"

/* Log lines and progress on stderr: one redrawn line on a terminal, plain lines otherwise. */
void cn_app_console(cn_context *ctx);

/* Draws how much of `total` is done: 0 to CN_APP_BAR of '#', then '.'. Returns percent, 0 to 100; what is more than
 * all, negative or no number is drawn as the nearest of these, and an unknown total (0) as nothing done. */
enum { CN_APP_BAR = 20 };
int cn_app_bar(double done, double total, char out[CN_APP_BAR + 1]);

/* Words after the command. */
typedef struct cn_app_args {
    int n;
    char **words;
} cn_app_args;

typedef struct cn_app_command {
    const char *name, *summary, *usage; /* usage: options and an example */
    cn_status (*run)(const cn_context *ctx, const cn_app_args *args);
} cn_app_command;
/* One a command, each in its cmd_NAME.c; commands.c lists them. */
extern const cn_app_command cn_app_init, cn_app_poses, cn_app_plan, cn_app_train, cn_app_render, cn_app_relight,
    cn_app_appearance, cn_app_tradeoff, cn_app_eval, cn_app_export, cn_app_run;
extern const cn_app_command cn_app_match, cn_app_steady;
extern const cn_app_command cn_app_status, cn_app_submit, cn_app_doctor;
extern const cn_app_command *const cn_app_commands[];
extern const int cn_app_n_commands;

/* One option of a command: takes a text, a number (with s, m or h for seconds, minutes, hours) or nothing (flag). */
typedef struct cn_app_option {
    const char *name;
    const char **text;
    double *number;
    bool *flag;
} cn_app_option;
/* Takes the city, then options; the list ends with a NULL name. CN_ERR_USAGE says what is wrong. */
CN_NODISCARD cn_status cn_app_parse(const cn_app_args *args, const char **city, const cn_app_option *options);
/* *quality is -1 when name is NULL. */
CN_NODISCARD cn_status cn_app_parse_quality(const char *name, int *quality);
#endif
