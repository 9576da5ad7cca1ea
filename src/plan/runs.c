/* Photo lists of large plans: runs of view indices, "0-15 17 20-25". They are valid for one list of views, identified
 * by its hash. */
#include "plan/plan.h"

#include "base/hash.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The hash of all names in order, so that an index keeps its meaning. */
void cn_plan_views_hash(const cn_scene *scene, char hex[17])
{
    uint64_t hash = 0;
    for (uint32_t i = 0; i < scene->n_views; i++)
        hash = hash * UINT64_C(0x9e3779b97f4a7c15) + cn_hash64(scene->views[i].name, strlen(scene->views[i].name));
    cn_hash_hex(hash, hex);
}

char *cn_plan_runs_write(const uint32_t *views, uint32_t n)
{
    char *text = malloc((size_t)n * 22 + 1), *at = text; /* two numbers of at most 10 digits, '-' and ' ' */
    if (!text) return NULL;
    *at = '\0';
    for (uint32_t i = 0, end; i < n; i = end) {
        for (end = i + 1; end < n && views[end] == views[end - 1] + 1;)
            end++;
        at += sprintf(at, at == text ? "%u" : " %u", views[i]);
        if (end > i + 1) at += sprintf(at, "-%u", views[end - 1]);
    }
    char *fitting = realloc(text, (size_t)(at - text) + 1);
    return fitting ? fitting : text;
}

/* Parses one number of digits only, below limit, and returns its end. */
static bool read_index(const char **at, uint32_t limit, uint32_t *index)
{
    uint64_t value = 0;
    const char *p = *at;
    for (; *p >= '0' && *p <= '9' && value <= UINT32_MAX; p++)
        value = 10 * value + (uint64_t)(*p - '0');
    if (p == *at || value >= limit) return false;
    *index = (uint32_t)value;
    *at = p;
    return true;
}

/* Goes through the runs; fills views when it is not NULL. False when they are not ascending indices below limit. */
static bool walk(const char *text, uint32_t limit, uint32_t *views, uint32_t *n)
{
    uint32_t next = 0, first, last;
    *n = 0;
    for (const char *p = text; *p;) {
        if (p != text && *p++ != ' ') return false;
        if (!read_index(&p, limit, &first) || first < next) return false;
        last = first;
        if (*p == '-' && (p++, !read_index(&p, limit, &last) || last <= first)) return false;
        for (uint32_t v = first; views && v <= last; v++)
            views[*n + v - first] = v;
        *n += last - first + 1;
        next = last + 1;
    }
    return true;
}

cn_status cn_plan_runs_read(const char *text, uint32_t limit, const char *where, uint32_t **views, uint32_t *n)
{
    *views = NULL;
    if (!walk(text, limit, NULL, n))
        return cn_fail(CN_ERR_FORMAT, "%s: \"%.40s\" is not a list of photos; run `conurb plan` again", where, text);
    *views = malloc(sizeof **views * (*n + (size_t)1));
    if (!*views) return cn_fail(CN_ERR_NOMEM, "out of memory for %u photos of %s", *n, where);
    (void)walk(text, limit, *views, n);
    return CN_OK;
}
