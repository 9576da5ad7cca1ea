/* What one photo alone shows before things that other photos see, such as leaves, a parked car or a passer-by. */
#ifndef CONURB_EFFECT_OCCLUDERS_H
#define CONURB_EFFECT_OCCLUDERS_H
#include "conurb/plan.h"
#include "photo/store.h"

typedef struct cn_occluders {
    uint32_t n_photos, n_found;        /* training photos of the tile, and those of them in which there is something */
    uint32_t (*cells)[CN_HIDDEN_ROWS]; /* [n_photos], as in cn_pixel_store_hide */
} cn_occluders;

/* Looks for them in the tile's training photos. Finds none where more than a quarter of the photos would have some, or
 * where a tile has too few sparse points or too many photos. The caller deinits. CN_ERR_NOMEM, or the store's errors.
 */
CN_NODISCARD cn_status cn_occluders_find(const cn_plan_input *input, const cn_plan_tile *tile, cn_occluders *occluders);
void cn_occluders_deinit(cn_occluders *occluders);
/* The part of a photo that they hide. */
double cn_occluders_share(const cn_occluders *occluders, uint32_t photo);
#endif
