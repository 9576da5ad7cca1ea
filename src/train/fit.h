/* How far two fits of one light agree. Private to train/. */
#ifndef CONURB_TRAIN_FIT_H
#define CONURB_TRAIN_FIT_H
#include <stddef.h>

/* What part of a change is to be believed that was fitted to all of a photo, 0 to 1. fitted: two rows of n numbers, one
 * fitted to each half of the photo, both from `start`. Both halves have one light, so the two changes differ by what
 * each half leaves open. Their cosine says what part of one of them is common to both. Of a change that was fitted to
 * both halves this part is 2 cosine / (1 + cosine) (Spearman and Brown's formula). precision: what a number's change
 * counts. 1 where a half changes nothing.
 * Found on herz-jesus: in 0000.jpg, whose fit cost 6 and 7 dB in two trainings, the cosines of its appearance were 0.09
 * and 0.20, in the other photos 0.56 to 0.98. */
double cn_fit_agreement(size_t n, const float *start, const float *const fitted[2], const double *precision);
#endif
