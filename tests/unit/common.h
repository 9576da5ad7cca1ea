/* What unit tests of several modules need. Every test program is linked with it. */
#ifndef CONURB_TEST_COMMON_H
#define CONURB_TEST_COMMON_H
#include "conurb/base.h"

#include <stddef.h>

/* Removes a folder with all that is in it. 0 when all is gone. */
int folder_remove(const char *folder);

/* How often FOLDER/NAME has the word; 0 without such a file. */
size_t file_count(const char *folder, const char *name, const char *word);

/* Keeps what is logged, a line each: static char logged[LOGGED]; ctx = { .log = log_append, .user = logged }. */
enum { LOGGED = 8192 };
/* user: char[LOGGED]. Lines that have no room are cut. */
void log_append(void *user, cn_log_level level, const char *text);

/* One file for all tests of a program: the set-up and the tear-down of their group make and remove it. */
extern char text_file[];
int text_file_make(void **state);
int text_file_remove(void **state);
/* Replaces what is in it. */
void text_file_write(const char *text);
#endif
