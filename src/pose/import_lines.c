#include "pose/import_lines.h"

#include "base/file.h"
#include "base/number.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define BLANKS " \t\r"

void cn_import_lines_deinit(cn_import_lines *lines)
{
    free(lines->data);
    free(lines->lines);
    free(lines->numbers);
    memset(lines, 0, sizeof *lines);
}

/* Splits the text in place. */
static void split(cn_import_lines *to, size_t size)
{
    size_t number = 0;
    for (char *at = to->data, *end = to->data + size; at < end;) {
        char *newline = memchr(at, '\n', (size_t)(end - at)), *next = newline ? newline + 1 : end;
        char *last = newline ? newline : end;
        number++;
        while (last > at && strchr(BLANKS, last[-1]))
            last--;
        *last = '\0';
        at += strspn(at, BLANKS);
        if (*at && *at != '#') {
            to->numbers[to->n] = number;
            to->lines[to->n++] = at;
        }
        at = next;
    }
}

cn_status cn_import_lines_read(const char *path, cn_import_lines *out)
{
    size_t size, most = 1;
    *out = (cn_import_lines){ .path = path };
    CN_TRY(cn_file_read(path, 0, &out->data, &size));
    for (size_t i = 0; i < size; i++)
        most += out->data[i] == '\n';
    out->lines = malloc(most * sizeof *out->lines);
    out->numbers = malloc(most * sizeof *out->numbers);
    if (!out->lines || !out->numbers) {
        cn_import_lines_deinit(out);
        return cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    }
    split(out, size);
    return CN_OK;
}

cn_status cn_import_lines_fault(const cn_import_lines *lines, size_t i, const char *what)
{
    if (i >= lines->n) return cn_fail(CN_ERR_FORMAT, "%s: the file ends before %s; export it again", lines->path, what);
    return cn_fail(CN_ERR_FORMAT, "%s: line %zu: %s expected; the file is damaged, export it again", lines->path,
                   lines->numbers[i], what);
}

cn_status cn_import_lines_numbers(const cn_import_lines *lines, size_t i, const cn_import_numbers *to)
{
    if (i >= lines->n) return cn_import_lines_fault(lines, i, to->what);
    const char *at = to->at ? to->at : lines->lines[i];
    for (size_t k = 0; k < to->n; k++) {
        char *end;
        to->out[k] = cn_parse_double(at, &end);
        if (end == at || !isfinite(to->out[k])) return cn_import_lines_fault(lines, i, to->what);
        at = end;
    }
    return at[strspn(at, BLANKS)] ? cn_import_lines_fault(lines, i, to->what) : CN_OK;
}

cn_status cn_import_lines_count(const cn_import_lines *lines, size_t i, const char *what, size_t *count)
{
    double value;
    CN_TRY(cn_import_lines_numbers(lines, i, &(cn_import_numbers){ .what = what, .out = &value, .n = 1 }));
    if (!(value >= 0.0 && value == floor(value))) return cn_import_lines_fault(lines, i, what);
    if (value > (double)(lines->n - 1 - i))
        return cn_fail(CN_ERR_FORMAT,
                       "%s: line %zu: %s is %.0f, but %zu lines follow; the file is cut, export it again", lines->path,
                       lines->numbers[i], what, value, lines->n - 1 - i);
    *count = (size_t)value;
    return CN_OK;
}
