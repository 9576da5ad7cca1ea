/* The light of photos that were not trained on. Private to train/. */
#ifndef CONURB_TRAIN_UNSEEN_LIGHT_H
#define CONURB_TRAIN_UNSEEN_LIGHT_H
#include "conurb/pose.h"

/* rows[n][width], of which the first n_trained were trained and have a mean of zero; the others are set to what their
 * neighbours' rows say, by place and direction of view. How far neighbours are trusted is found among the trained
 * photos: each is predicted from its neighbours, and the prediction that is best by least squares lies between zero,
 * the mean light, and all of the neighbours' row. A light that changes from photo to photo is left at the mean, one
 * that changes slowly along a walk follows it. views[n]. */
void cn_unseen_light(const cn_view *const *views, uint32_t n, uint32_t n_trained, uint32_t width, float *rows);
#endif
