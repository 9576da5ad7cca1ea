/* The light of photos that were not trained on. Private to train/. */
#ifndef CONURB_TRAIN_UNSEEN_LIGHT_H
#define CONURB_TRAIN_UNSEEN_LIGHT_H
#include "conurb/pose.h"

/* Sets the rows of photos that were not trained on. The first n_trained of rows[n][width] were trained and have zero
 * mean. Each other row becomes a part of its neighbours' row; neighbours are near in place and direction of view. The
 * part is between 0 (the mean light) and 1. It is found among the trained photos: the part with which their neighbours
 * predict them best, by least squares. So a light that changes from photo to photo stays at the mean, and a light that
 * changes slowly along a walk follows its neighbours. views[n]. */
void cn_unseen_light(const cn_view *const *views, uint32_t n, uint32_t n_trained, uint32_t width, float *rows);
#endif
