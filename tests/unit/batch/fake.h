/* A cluster's programs as shell scripts, in a folder that PATH names first. */
#ifndef CONURB_TESTS_BATCH_FAKE_H
#define CONURB_TESTS_BATCH_FAKE_H
#include "batch/submit.h"
#include "conurb/base.h"

/* Makes an empty folder and a context that keeps the log; ends the test program when that fails. */
void fake_begin(void);
void fake_end(void);        /* removes the folder */
const char *fake_dir(void); /* the folder */
const char *fake_log(void); /* all log lines since fake_begin */
extern cn_context fake_ctx;
/* PATH becomes this program and the system's shell tools. Each call appends its arguments, one a line, and a blank line
 * to DIR/calls. Then it runs `script`. */
void fake_program(const char *name, const char *script);
void fake_no_program(void); /* PATH becomes an empty folder */
/* A file of the folder. The caller frees the text of fake_read; "" when there is no such file. */
void fake_write(const char *name, const char *text);
char *fake_read(const char *name);

/* Begins as above, with an empty submission of the city NAME in the folder; there is a folder for its jobs. The end
 * frees what the jobs, the submission and the city hold. */
void fake_submission_begin(cn_submission *submission, cn_city *city, const cn_submit_options *options,
                           const char *name);
void fake_submission_end(cn_submission *submission, cn_city *city);
#endif
