/* Validation photos: with train.stop_gain_db they decide when training stops. They are taken from a tile's training
 * photos. The held-out photos, which score the tile, are not used for that. */
#ifndef CONURB_STAGE_VALIDATION_H
#define CONURB_STAGE_VALIDATION_H
#include "conurb/plan.h"

enum { CN_VALIDATION_MOST = 8, CN_VALIDATION_SHARE = 8 /* at most one photo in n */ };

/* Two copies of the tile; only the lists of photos are not borrowed from the plan. */
typedef struct cn_validation {
    cn_plan_tile train;    /* trains on the rest; holds out the validation photos too */
    cn_plan_tile validate; /* holds out the validation photos alone; none where the tile has too few photos */
} cn_validation;

/* Chooses n of the tile's photos, at most CN_VALIDATION_MOST, evenly spaced; always the same ones. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_validation_take(cn_validation *validation, const cn_plan_tile *tile, uint32_t n);
/* The same, with as many photos as early stopping needs. */
CN_NODISCARD cn_status cn_validation_init(cn_validation *validation, const cn_plan_tile *tile);
void cn_validation_deinit(cn_validation *validation);
#endif
