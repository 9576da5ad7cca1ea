#include "pose/finder.h"

#include "base/file.h"

#include <stdlib.h>
#include <string.h>

static int compare_entries(const void *a, const void *b)
{
    const cn_finder_entry *x = a, *y = b;
    const int order = strcmp(x->name, y->name);
    return order ? order : (x->photo > y->photo) - (x->photo < y->photo);
}

/* An index is sorted by name, so usually nothing needs sorting. */
static void sort_entries(cn_finder_entry *entries, uint32_t n)
{
    for (uint32_t i = 1; i < n; i++)
        if (strcmp(entries[i - 1].name, entries[i].name) > 0) {
            qsort(entries, n, sizeof *entries, compare_entries);
            return;
        }
}

static bool in_same_folder(const char *a, const char *b)
{
    const size_t n = (size_t)(cn_path_base(a) - a);
    return n == (size_t)(cn_path_base(b) - b) && memcmp(a, b, n) == 0;
}

cn_status cn_photo_finder_init(cn_photo_finder *f, const cn_photo_index *index)
{
    f->n = index->n_photos;
    f->of = index;
    f->ignores_folders = true;
    f->whole = malloc(sizeof *f->whole * 2 * (f->n + (size_t)1));
    f->bare = f->whole + f->n;
    if (!f->whole) return cn_fail(CN_ERR_NOMEM, "out of memory for the names of %u photos", f->n);
    for (uint32_t i = 0; i < f->n; i++) {
        f->whole[i] = (cn_finder_entry){ index->photos[i].name, i };
        f->bare[i] = (cn_finder_entry){ cn_path_base(index->photos[i].name), i };
        f->ignores_folders = f->ignores_folders && in_same_folder(index->photos[0].name, index->photos[i].name);
    }
    sort_entries(f->whole, f->n);
    sort_entries(f->bare, f->n);
    return CN_OK;
}

void cn_photo_finder_deinit(cn_photo_finder *f)
{
    free(f->whole);
    *f = (cn_photo_finder){ 0 };
}

/* The first entry that is not less than name. */
static uint32_t lower_bound(const cn_finder_entry *entries, uint32_t n, const char *name)
{
    uint32_t low = 0, high = n;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (strcmp(entries[middle].name, name) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

int64_t cn_photo_finder_find(const cn_photo_finder *f, const char *name)
{
    uint32_t i = lower_bound(f->whole, f->n, name);
    if (i < f->n && strcmp(f->whole[i].name, name) == 0) return f->whole[i].photo;
    i = lower_bound(f->bare, f->n, name);
    if (i == f->n || strcmp(f->bare[i].name, name) != 0) return -1;
    const bool unique = i + 1 == f->n || strcmp(f->bare[i + 1].name, name) != 0;
    return unique ? (int64_t)f->bare[i].photo : -1;
}

/* Takes the last name off a path of n characters: the number of characters before it and its slashes. *name: where it
 * begins. */
static size_t step_back(const char *path, size_t n, size_t *name)
{
    while (n && path[n - 1] != '/')
        n--;
    *name = n;
    while (n && path[n - 1] == '/')
        n--;
    return n;
}

/* How many names both paths end with; 0 where both have other folders before these. */
static uint32_t count_common(const char *a, const char *b)
{
    size_t i = strlen(a), j = strlen(b);
    for (uint32_t n = 0;; n++) {
        size_t from_a, from_b;
        if (!i || !j) return n;
        const size_t before_a = step_back(a, i, &from_a), before_b = step_back(b, j, &from_b);
        if (i - from_a != j - from_b || memcmp(a + from_a, b + from_b, i - from_a) != 0) return 0;
        i = before_a;
        j = before_b;
    }
}

int64_t cn_photo_finder_match(const cn_photo_finder *f, const char *path)
{
    /* That the photos lie above the file of poses does not tell their folder. */
    while (strncmp(path, "./", 2) == 0 || strncmp(path, "../", 3) == 0)
        path = strchr(path, '/') + 1;
    const int64_t exact = cn_photo_finder_find(f, path);
    if (exact >= 0) return exact;
    const char *base = cn_path_base(path);
    if (f->ignores_folders) return cn_photo_finder_find(f, base);
    int64_t found = -1;
    uint32_t most = 0;
    for (uint32_t i = lower_bound(f->bare, f->n, base); i < f->n && strcmp(f->bare[i].name, base) == 0; i++) {
        const uint32_t n = count_common(path, f->of->photos[f->bare[i].photo].name);
        if (n == most) found = -1;
        if (n > most) found = f->bare[i].photo;
        if (n > most) most = n;
    }
    return found;
}

const char *cn_photo_finder_ending(const cn_photo_finder *f, const char *path, uint32_t n)
{
    const char *base = cn_path_base(path);
    const size_t length = strlen(base);
    for (uint32_t i = lower_bound(f->bare, f->n, base); i < f->n; i++) {
        const char *name = f->bare[i].name;
        if (strncmp(name, base, length) != 0) return NULL;
        if (name[length] != '.' || strchr(name + length + 1, '.')) continue;
        if (n-- == 0) return name + length + 1;
    }
    return NULL;
}
