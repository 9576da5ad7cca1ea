/* Numbers in files, options and keys have a decimal point, whatever the locale is. printf, scanf and strtod use the
 * locale of the calling thread; these functions do not. Any thread. */
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
/* Between the two calls, printf, scanf and strtod of this thread use a decimal point: for a whole file, or for a
 * library that reads numbers. Pass to the second what the first returned. Pairs may be nested. */
locale_t cn_number_begin(void);
void cn_number_end(locale_t before);

#ifdef __cplusplus
}
#endif
#endif
