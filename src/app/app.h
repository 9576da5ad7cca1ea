/* The conurb program: parses the command line and calls the library. */
#ifndef CONURB_APP_APP_H
#define CONURB_APP_APP_H
#include "conurb/stage.h"

#include <sys/types.h>

/* Writes log lines and progress to stderr: on a terminal progress is one line that is redrawn, otherwise plain lines.
 */
void cn_app_console(cn_context *ctx);
/* Opens the devices of `name` (as in cn_device_create; NULL: those of CONURB_DEVICE, else "auto" for a command that
 * computes) and sets the first in ctx. CN_ERR_USAGE: there is no such name. */
CN_NODISCARD cn_status cn_app_choose_device(cn_context *ctx, const char *name, bool computes);

/* Draws a progress bar, 0 to CN_APP_BAR of '#' and then '.', and returns the percentage, 0 to 100. Values out of range
 * are clamped; an unknown total (0) counts as nothing done. */
enum { CN_APP_BAR = 20 };
int cn_app_bar(double done, double total, char out[CN_APP_BAR + 1]);

/* The kind of an option's value. A time is a number, followed by s, m or h for seconds, minutes or hours; without a
 * letter it is in seconds. A choice is one of the words of `values`. */
typedef enum cn_app_kind { CN_APP_FLAG, CN_APP_TEXT, CN_APP_NUMBER, CN_APP_TIME, CN_APP_CHOICE } cn_app_kind;

/* One option. Parsing, --help, the man page and the completion use this entry. */
typedef struct cn_app_option {
    const char *name;     /* without the dashes */
    const char *argument; /* name of its value in texts; NULL for a flag */
    const char *help;     /* one or more short sentences, without the last full stop */
    cn_app_kind kind;
    size_t offset;      /* offset of its member in the command's struct: bool, const char * or double */
    const char *values; /* words that completion offers, separated by blanks; --help lists those of a choice; or NULL */
} cn_app_option;

/* A parsed command line. */
typedef struct cn_app_call {
    int n;                   /* number of operands; the first is the city */
    const char *operands[4]; /* NULL from n on */
    const char *device;      /* the value of --device, or NULL */
    const void *options;     /* the command's own struct */
} cn_app_call;

typedef struct cn_app_command {
    const char *name, *summary;
    const char *forms;            /* forms of the operands, one per line: "CITY" */
    const char *about;            /* paragraphs, separated by an empty line */
    const char *example;          /* a command line that works */
    const char *verbs;            /* words that completion offers after the city, or NULL */
    const cn_app_option *options; /* ends with a NULL name; NULL: none */
    size_t size;                  /* size of the command's struct */
    const void *defaults;         /* a struct with the defaults; NULL: zeros */
    int min_operands, max_operands;
    bool computes;      /* trains or renders: uses a graphics processor where there is one */
    bool passes_device; /* the call's device is for other processes: this one opens none */
    cn_status (*run)(const cn_context *ctx, const cn_app_call *call);
} cn_app_command;
/* The commands, one per cmd_NAME.c; commands.c lists them. */
extern const cn_app_command cn_app_init, cn_app_poses, cn_app_plan, cn_app_train, cn_app_render, cn_app_relight,
    cn_app_appearance, cn_app_tradeoff, cn_app_eval, cn_app_export, cn_app_run;
extern const cn_app_command cn_app_match, cn_app_steady;
extern const cn_app_command cn_app_view;
extern const cn_app_command cn_app_status, cn_app_submit, cn_app_doctor;
extern const cn_app_command *const cn_app_commands[];
extern const int cn_app_n_commands;
/* The command of that name, or NULL. */
const cn_app_command *cn_app_find(const char *name);

/* Turns "a b c" into "a, b or c". */
void cn_app_list_values(const char *values, char out[256]);

/* The options of every command. */
typedef struct cn_app_common {
    bool help;
    const char *threads_text;
    unsigned threads; /* 0: one per processor */
    const char *device;
} cn_app_common;
extern const cn_app_option cn_app_common_options[];

/* Parses words[1] to words[n - 1]; words[0] is the command. Fills `values` (command->size bytes), first with the
 * defaults. CN_ERR_USAGE: the message says what is wrong. With --help, operands may be missing. */
CN_NODISCARD cn_status cn_app_parse(const cn_app_command *command, int n, char **words, cn_app_common *common,
                                    void *values, cn_app_call *call);
/* Values of options that several commands take. */
#define CN_APP_QUALITIES "preview standard high reference compact"
#define CN_APP_BLENDS "nearest distance_2d distance_3d visibility ownership"
/* Index of a name in CN_APP_QUALITIES; -1 for NULL: from city.yaml. */
int cn_app_quality(const char *name);

/* Starts `conurb view CITY` as a second process, on the call's device. It ends with this one at the latest. */
CN_NODISCARD cn_status cn_app_page_start(const cn_app_call *call, pid_t *page);
/* Ends that process; with `stay`, only after Ctrl-C. */
void cn_app_page_end(const cn_context *ctx, pid_t page, bool stay);

/* Print all commands, or one command with its options and an example, to standard output. */
void cn_app_print_commands(void);
void cn_app_print_help(const cn_app_command *command);
/* Writes DIR/man1/conurb.1, a page for each command, and DIR/completions/conurb. */
CN_NODISCARD cn_status cn_app_write_pages(const char *dir);
#endif
