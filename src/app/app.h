/* The conurb binary: a thin caller of the library. */
#ifndef CONURB_APP_APP_H
#define CONURB_APP_APP_H
#include "conurb/stage.h"

#include <sys/types.h>

/* Log lines and progress on stderr: one redrawn line on a terminal, plain lines otherwise. */
void cn_app_console(cn_context *ctx);
/* The device of this name (cpu, gpu, gpu:N), into ctx; NULL: the one that CONURB_DEVICE names. CN_ERR_USAGE for what is
 * no name. */
CN_NODISCARD cn_status cn_app_choose_device(cn_context *ctx, const char *name);

/* Draws how much of `total` is done: 0 to CN_APP_BAR of '#', then '.'. Returns percent, 0 to 100; what is more than
 * all, negative or no number is drawn as the nearest of these, and an unknown total (0) as nothing done. */
enum { CN_APP_BAR = 20 };
int cn_app_bar(double done, double total, char out[CN_APP_BAR + 1]);

/* What an option takes. A time is a number with s, m or h behind it for seconds, minutes, hours (no letter: seconds).
 * A choice is one of the words of `values`. */
typedef enum cn_app_kind { CN_APP_FLAG, CN_APP_TEXT, CN_APP_NUMBER, CN_APP_TIME, CN_APP_CHOICE } cn_app_kind;

/* One option. Parsing, --help, the man page and the completion all come from this. */
typedef struct cn_app_option {
    const char *name;     /* without the dashes */
    const char *argument; /* what stands for its value in texts; NULL for a flag */
    const char *help;     /* one or more short sentences, without the last full stop */
    cn_app_kind kind;
    size_t offset;      /* of its member in the command's struct: bool, const char * or double */
    const char *values; /* words that completion offers, with blanks between them, or NULL */
} cn_app_option;

/* What a person typed. */
typedef struct cn_app_call {
    int n;                   /* operands, of which the first is the city */
    const char *operands[4]; /* NULL from n on */
    const void *options;     /* the command's own struct */
} cn_app_call;

typedef struct cn_app_command {
    const char *name, *summary;
    const char *forms;            /* operands, one form a line: "CITY" */
    const char *about;            /* paragraphs, with an empty line between them */
    const char *example;          /* a line that a person can type */
    const char *verbs;            /* words that completion offers after the city, or NULL */
    const cn_app_option *options; /* ends with a NULL name; NULL: none */
    size_t size;                  /* of the command's struct */
    const void *defaults;         /* such a struct; NULL: zeros */
    int min_operands, max_operands;
    cn_status (*run)(const cn_context *ctx, const cn_app_call *call);
} cn_app_command;
/* One a command, each in its cmd_NAME.c; commands.c lists them. */
extern const cn_app_command cn_app_init, cn_app_poses, cn_app_plan, cn_app_train, cn_app_render, cn_app_relight,
    cn_app_appearance, cn_app_tradeoff, cn_app_eval, cn_app_export, cn_app_run;
extern const cn_app_command cn_app_match, cn_app_steady;
extern const cn_app_command cn_app_view;
extern const cn_app_command cn_app_status, cn_app_submit, cn_app_doctor;
extern const cn_app_command *const cn_app_commands[];
extern const int cn_app_n_commands;
/* NULL: there is no such command. */
const cn_app_command *cn_app_find(const char *name);

/* "a b c" to "a, b or c". */
void cn_app_list_values(const char *values, char out[256]);

/* Options that every command takes. */
typedef struct cn_app_common {
    bool help;
    const char *threads_text;
    unsigned threads; /* 0: one a processor */
    const char *device;
} cn_app_common;
extern const cn_app_option cn_app_common_options[];

/* Reads words[1] to words[n - 1]; words[0] is the command. `values` has command->size bytes and is filled in, first
 * with the defaults. CN_ERR_USAGE says what is wrong. With --help, operands may be missing. */
CN_NODISCARD cn_status cn_app_parse(const cn_app_command *command, int n, char **words, cn_app_common *common,
                                    void *values, cn_app_call *call);
/* Values of options that several commands take. */
#define CN_APP_QUALITIES "preview standard high reference"
#define CN_APP_BLENDS "nearest distance_2d distance_3d visibility ownership"
/* Place of a name in CN_APP_QUALITIES; -1 when it is NULL: as city.yaml says. */
int cn_app_quality(const char *name);

/* Starts `conurb view CITY` beside this process; it ends with it at the latest. */
CN_NODISCARD cn_status cn_app_page_start(const char *city, pid_t *page);
/* Ends it; with `stay`, first waits until a person has seen enough: Ctrl-C. */
void cn_app_page_end(const cn_context *ctx, pid_t page, bool stay);

/* All commands, or one command with its options and an example, on standard output. */
void cn_app_print_commands(void);
void cn_app_print_help(const cn_app_command *command);
/* Writes DIR/man1/conurb.1, a page for each command beside it, and DIR/completions/conurb. */
CN_NODISCARD cn_status cn_app_write_pages(const char *dir);
#endif
