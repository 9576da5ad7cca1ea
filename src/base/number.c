#include "base/number.h"

#include <stdio.h>
#include <stdlib.h>

/* uselocale sets the calling thread only, so a program's own threads keep their locale. The C library makes the "C"
 * locale without allocating: this cannot fail. */
locale_t cn_number_begin(void)
{
    return uselocale(newlocale(LC_ALL_MASK, "C", (locale_t)0));
}

void cn_number_end(locale_t before)
{
    uselocale(before);
}

double cn_parse_double(const char *text, char **end)
{
    const locale_t before = cn_number_begin();
    const double value = strtod(text, end);
    cn_number_end(before);
    return value;
}

int cn_vprint(char *out, size_t size, const char *format, va_list arguments)
{
    const locale_t before = cn_number_begin();
    const int length = vsnprintf(out, size, format, arguments);
    cn_number_end(before);
    return length;
}

int cn_print(char *out, size_t size, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    const int length = cn_vprint(out, size, format, arguments);
    va_end(arguments);
    return length;
}
