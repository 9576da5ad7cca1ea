/* What the rows of trained photos, and fits to parts of a photo, tell about the row of that photo. Private to train/.
 */
#ifndef CONURB_TRAIN_FIT_H
#define CONURB_TRAIN_FIT_H
#include "conurb/tile.h"

/* Mean and precision (1 / variance) of the trained photos' rows, without their constants; precision is 0 where they say
 * nothing. */
typedef struct cn_fit_prior {
    double mean[CN_APPEARANCE_MAX], precision[CN_APPEARANCE_MAX];
} cn_fit_prior;
/* open: the share of the rays that see a background. Only these speak for its numbers, so against them the trained
 * photos count in proportion. */
cn_fit_prior cn_fit_prior_of(const cn_tile *tile, double open);

/* Some of the trained photos, spread over all of them, whose rows a fit may start from. */
enum { CN_FIT_STARTS = 48 };
uint32_t cn_fit_starts(const cn_tile *tile);
const char *cn_fit_start_name(const cn_tile *tile, uint32_t i);
/* Sets the numbers of backgrounds in a row to those of the trained photos in such a light. A photo's rays may show no
 * background, or too little of it to tell; the mean background would then stand over a scene in another light.
 * error[cn_fit_starts(tile)]: mean squared error of the rays with the row of each; one that is not finite does
 * not count. */
void cn_fit_expect_background(const cn_tile *tile, const double *error, cn_appearance *row);

/* What part of a change is to be believed that was fitted to all of a photo, 0 to 1. fitted: two rows of n numbers, one
 * fitted to each half of the photo, both from `start`. Both halves have one light, so the two changes differ by what
 * each half leaves open. Their cosine says what part of one of them is common to both. Of a change that was fitted to
 * both halves this part is 2 cosine / (1 + cosine) (Spearman and Brown's formula). precision: what a number's change
 * counts. 1 where a half changes nothing.
 * Found on herz-jesus: in 0000.jpg, whose fit cost 6 and 7 dB in two trainings, the cosines of its appearance were 0.09
 * and 0.20, in the other photos 0.56 to 0.98. */
double cn_fit_agreement(size_t n, const float *start, const float *const fitted[2], const double *precision);
#endif
