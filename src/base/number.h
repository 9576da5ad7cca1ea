/* Numbers in files, options and keys have a dot, whatever locale the program that uses this library has set. printf,
 * scanf and strtod go by the locale of the calling thread; these do not. Any thread. */
#ifndef CONURB_BASE_NUMBER_H
#define CONURB_BASE_NUMBER_H
#include "conurb/base.h"
#include <locale.h>

#ifdef __cplusplus
extern "C" {
#endif

/* As strtod. */
double cn_parse_double(const char *text, char **end);
/* As snprintf and vsnprintf. */
int cn_print(char *out, size_t size, const char *format, ...) CN_PRINTF(3, 4);
int cn_vprint(char *out, size_t size, const char *format, va_list arguments);
/* Between the two, printf, scanf and strtod of this thread use dots: for a whole file, or a library that reads numbers.
 * Give back what begin returned. Pairs nest. */
locale_t cn_number_begin(void);
void cn_number_end(locale_t before);

#ifdef __cplusplus
}
#endif
#endif
