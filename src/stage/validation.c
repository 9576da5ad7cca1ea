#include "stage/validation.h"

#include <stdlib.h>
#include <string.h>

static int compare(const void *a, const void *b)
{
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

cn_status cn_validation_take(cn_validation *v, const cn_plan_tile *tile, uint32_t n)
{
    v->train = v->validate = *tile;
    v->train.photos = calloc(tile->n_photos + 1u, sizeof *v->train.photos);
    v->train.held_out = calloc((size_t)tile->n_held_out + n + 1u, sizeof *v->train.held_out);
    v->validate.photos = NULL;
    v->validate.held_out = calloc(n + 1u, sizeof *v->validate.held_out);
    v->train.n_photos = v->validate.n_photos = v->validate.n_held_out = 0;
    if (!v->train.photos || !v->train.held_out || !v->validate.held_out) {
        cn_validation_deinit(v);
        return cn_fail(CN_ERR_NOMEM, "out of memory");
    }
    /* The middles of n equal runs of the photos. */
    for (uint32_t i = 0, next = 0; i < tile->n_photos; i++) {
        if (next < n && i == (uint32_t)((2 * (uint64_t)next + 1) * tile->n_photos / (2 * (uint64_t)n))) {
            v->validate.held_out[next++] = tile->photos[i];
            continue;
        }
        v->train.photos[v->train.n_photos++] = tile->photos[i];
    }
    v->validate.n_held_out = n;
    v->train.n_held_out = tile->n_held_out + n;
    memcpy(v->train.held_out, v->validate.held_out, n * sizeof *v->train.held_out);
    if (tile->n_held_out) memcpy(v->train.held_out + n, tile->held_out, tile->n_held_out * sizeof *v->train.held_out);
    qsort(v->train.held_out, v->train.n_held_out, sizeof *v->train.held_out, compare);
    return CN_OK;
}

cn_status cn_validation_init(cn_validation *v, const cn_plan_tile *tile)
{
    const uint32_t share = tile->n_photos / CN_VALIDATION_SHARE;
    return cn_validation_take(v, tile, share < CN_VALIDATION_MOST ? share : CN_VALIDATION_MOST);
}

void cn_validation_deinit(cn_validation *v)
{
    free(v->train.photos);
    free(v->train.held_out);
    free(v->validate.held_out);
    v->train.photos = v->train.held_out = v->validate.held_out = NULL;
}
