/* The files of the page, embedded in the library. */
#ifndef CONURB_VIEW_PAGES_H
#define CONURB_VIEW_PAGES_H
#include <stddef.h>

typedef struct cn_page {
    const char *path; /* "/view.js" */
    const char *type; /* "text/javascript" */
    const char *text;
} cn_page;
/* The file at a path; "/" is the page itself. NULL: there is no such file. */
const cn_page *cn_page_find(const char *path);
/* File i of the list; NULL past the end. */
const cn_page *cn_page_at(size_t i);
#endif
