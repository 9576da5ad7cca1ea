#include "photo/reuse.h"

#include <stdlib.h>

static int compare(uint64_t a, uint64_t b)
{
    return (a > b) - (a < b);
}

static int compare_records(const cn_store_record *a, const cn_store_record *b)
{
    int order = compare(a->hash, b->hash);
    if (!order) order = compare(a->mask_hash, b->mask_hash);
    if (!order) order = compare(a->depth_hash, b->depth_hash);
    if (!order) order = compare(a->normal_hash, b->normal_hash);
    if (!order) order = compare(a->width, b->width);
    return order ? order : compare(a->height, b->height);
}

/* Equal records stay in the order of the store. */
static int by_content(const void *a, const void *b, void *user)
{
    const cn_store_record *records = user;
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    const int order = compare_records(&records[x], &records[y]);
    return order ? order : compare(x, y);
}

cn_status cn_reuse_init(cn_reuse *reuse, const cn_pixel_store *store)
{
    *reuse = (cn_reuse){ .store = store };
    if (!store) return CN_OK;
    const size_t n = store->head.n_photos;
    reuse->order = malloc((n + 1) * sizeof *reuse->order);
    if (!reuse->order) return cn_fail(CN_ERR_NOMEM, "out of memory for the photos of %s", store->path);
    for (size_t i = 0; i < n; i++)
        reuse->order[i] = (uint32_t)i;
    qsort_r(reuse->order, n, sizeof *reuse->order, by_content, store->records);
    return CN_OK;
}

void cn_reuse_deinit(cn_reuse *reuse)
{
    free(reuse->order);
    *reuse = (cn_reuse){ 0 };
}

const cn_store_record *cn_reuse_find(const cn_reuse *reuse, const cn_store_record *wanted)
{
    size_t first = 0, end = reuse->store ? reuse->store->head.n_photos : 0;
    const size_t n = end;
    while (first < end) {
        const size_t middle = first + (end - first) / 2;
        if (compare_records(&reuse->store->records[reuse->order[middle]], wanted) < 0)
            first = middle + 1;
        else
            end = middle;
    }
    const cn_store_record *found = first < n ? &reuse->store->records[reuse->order[first]] : NULL;
    return found && compare_records(found, wanted) == 0 ? found : NULL;
}
