#include "base/file.h"
#include "base/number.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

char *cn_format(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    char *text = NULL;
    const locale_t before = cn_number_begin();
    int length = vasprintf(&text, format, arguments);
    cn_number_end(before);
    va_end(arguments);
    return length < 0 ? NULL : text;
}

char *cn_path_join(const char *folder, const char *name)
{
    size_t length = strlen(folder);
    if (length == 0 || name[0] == '/') return strdup(name);
    return cn_format(folder[length - 1] == '/' ? "%s%s" : "%s/%s", folder, name);
}

const char *cn_path_base(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

static bool is_digit(char c)
{
    return c >= '0' && c <= '9';
}

/* Two numbers, at *a and *b, which are moved behind them. */
static int compare_numbers(const char **a, const char **b)
{
    const char *end[2];
    while (**a == '0')
        ++*a;
    while (**b == '0')
        ++*b;
    for (end[0] = *a; is_digit(*end[0]);)
        end[0]++;
    for (end[1] = *b; is_digit(*end[1]);)
        end[1]++;
    const ptrdiff_t longer = (end[0] - *a) - (end[1] - *b);
    const int order = longer ? (longer > 0) - (longer < 0) : memcmp(*a, *b, (size_t)(end[0] - *a));
    *a = end[0];
    *b = end[1];
    return order;
}

int cn_path_compare(const char *a, const char *b)
{
    const char *x = a, *y = b;
    while (*x && *y) {
        int order;
        if (is_digit(*x) && is_digit(*y))
            order = compare_numbers(&x, &y);
        else
            order = (unsigned char)*x++ - (unsigned char)*y++;
        if (order) return order;
    }
    if (*x || *y) return *x ? 1 : -1;
    return strcmp(a, b); /* 007 and 7 */
}

typedef struct named {
    const char *name;
    uint32_t number;
} named;

static int compare_named(const void *a, const void *b)
{
    const named *x = a, *y = b;
    const int order = cn_path_compare(x->name, y->name);
    return order ? order : (x->number > y->number) - (x->number < y->number);
}

uint32_t *cn_path_order(uint32_t n, const char *(*name)(const void *of, uint32_t i), const void *of)
{
    named *all = malloc((n + (size_t)1) * sizeof *all);
    uint32_t *order = malloc((n + (size_t)1) * sizeof *order);
    for (uint32_t i = 0; all && order && i < n; i++)
        all[i] = (named){ name(of, i), i };
    if (all && order) qsort(all, n, sizeof *all, compare_named);
    for (uint32_t i = 0; all && order && i < n; i++)
        order[i] = all[i].number;
    if (!all) {
        free(order);
        order = NULL;
    }
    free(all);
    return order;
}

cn_status cn_path_absolute(const char *path, char **absolute)
{
    *absolute = realpath(path, NULL);
    if (*absolute) return CN_OK;
    if (errno == ENOMEM) return cn_fail(CN_ERR_NOMEM, "out of memory");
    return cn_fail(CN_ERR_IO, "cannot find %s: %s", path, strerror(errno));
}

char *cn_file_temporary(const char *path)
{
    const char *base = cn_path_base(path);
    const char *dot = strrchr(base, '.');
    if (!dot || dot == base) dot = base + strlen(base);
    return cn_format("%.*s.%.*s.tmp-%ld%s", (int)(base - path), path, (int)(dot - base), base, (long)getpid(), dot);
}

bool cn_file_exists(const char *path)
{
    struct stat status;
    return stat(path, &status) == 0;
}
