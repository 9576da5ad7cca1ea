/* Finds pixels in an older store, by the photo's bytes, its mask, its maps and its size. */
#ifndef CONURB_PHOTO_REUSE_H
#define CONURB_PHOTO_REUSE_H
#include "photo/store.h"

typedef struct cn_reuse {
    const cn_pixel_store *store;
    uint32_t *order; /* its records, sorted */
} cn_reuse;
/* store is borrowed; NULL: nothing is found. */
CN_NODISCARD cn_status cn_reuse_init(cn_reuse *reuse, const cn_pixel_store *store);
void cn_reuse_deinit(cn_reuse *reuse);
/* The first record of the same photo with the same mask and maps at the same size, or NULL. O(log n). Any thread. */
const cn_store_record *cn_reuse_find(const cn_reuse *reuse, const cn_store_record *wanted);
#endif
