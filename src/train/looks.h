/* Where the trained photos look. Private to train/. */
#ifndef CONURB_TRAIN_LOOKS_H
#define CONURB_TRAIN_LOOKS_H
#include "effect/effect.h"
#include "train/sampler.h"

enum { CN_LOOKS = 960 }; /* directions of a hemisphere: 4.7 degrees apart */

/* Fills dir[CN_LOOKS], directions above 9 degrees below the horizon, evenly; and look[CN_LOOKS], a cn_look each. */
void cn_looks_find(const cn_sampler *sampler, float (*dir)[3], uint8_t *look);
#endif
