/* Validation photos: with train.stop_gain_db they decide when training stops. They are taken from a tile's training
 * photos, so that the held-out photos, which score the tile, have no say in it. */
#ifndef CONURB_STAGE_VALIDATION_H
#define CONURB_STAGE_VALIDATION_H
#include "conurb/plan.h"

enum { CN_VALIDATION_MOST = 8, CN_VALIDATION_SHARE = 8 /* of the photos, one in so many at most */ };

/* The tile twice, with everything but the lists of photos borrowed from the plan. */
typedef struct cn_validation {
    cn_plan_tile train;    /* trains on the rest; holds out the validation photos too */
    cn_plan_tile validate; /* holds out the validation photos alone; none where the tile has too few photos */
} cn_validation;

/* n of the tile's photos, at most CN_VALIDATION_MOST; the same ones each time, evenly spread. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_validation_take(cn_validation *validation, const cn_plan_tile *tile, uint32_t n);
/* As many as stopping needs. The same photos each time, evenly spread. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_validation_init(cn_validation *validation, const cn_plan_tile *tile);
void cn_validation_deinit(cn_validation *validation);
#endif
