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

cn_status cn_photo_finder_init(cn_photo_finder *f, const cn_photo_index *index)
{
    f->n = index->n_photos;
    f->whole = malloc(sizeof *f->whole * 2 * (f->n + (size_t)1));
    f->bare = f->whole + f->n;
    if (!f->whole) return cn_fail(CN_ERR_NOMEM, "out of memory for the names of %u photos", f->n);
    for (uint32_t i = 0; i < f->n; i++) {
        f->whole[i] = (cn_finder_entry){ index->photos[i].name, i };
        f->bare[i] = (cn_finder_entry){ cn_path_base(index->photos[i].name), i };
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
