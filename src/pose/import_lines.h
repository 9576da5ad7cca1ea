/* Text files of poses, line by line. */
#ifndef CONURB_POSE_IMPORT_LINES_H
#define CONURB_POSE_IMPORT_LINES_H
#include "conurb/base.h"

/* The lines of a file without blanks at their ends. Empty lines and comments (#) are left out. */
typedef struct cn_import_lines {
    const char *path; /* borrowed */
    char *data, **lines;
    size_t *numbers; /* of the lines in the file, from 1 */
    size_t n;
} cn_import_lines;

/* The caller frees the lines with cn_import_lines_deinit; they are empty on failure. */
CN_NODISCARD cn_status cn_import_lines_read(const char *path, cn_import_lines *out);
void cn_import_lines_deinit(cn_import_lines *lines);
/* CN_ERR_FORMAT: what is wrong with line i; past the last line: the file is cut. */
cn_status cn_import_lines_fault(const cn_import_lines *lines, size_t i, const char *what);
/* The n numbers that make up line i from `at` on, or the whole line where that is NULL. All are finite. what: their
 * name, for the message. */
typedef struct cn_import_numbers {
    const char *at, *what;
    double *out;
    size_t n;
} cn_import_numbers;
CN_NODISCARD cn_status cn_import_lines_numbers(const cn_import_lines *lines, size_t i, const cn_import_numbers *to);
/* Line i as a count, at most the number of lines after it. */
CN_NODISCARD cn_status cn_import_lines_count(const cn_import_lines *lines, size_t i, const char *what, size_t *count);
#endif
