/* The light of photos that were not trained on. Private to train/. */
#ifndef CONURB_TRAIN_UNSEEN_LIGHT_H
#define CONURB_TRAIN_UNSEEN_LIGHT_H
#include "conurb/pose.h"

/* Sets the rows of photos that were not trained on. The first n_trained of rows[n][width] were trained and have zero
 * mean. Each other row becomes a part of the mean row of its capture run, and a part of what its neighbours have beside
 * theirs; neighbours are near in place and direction of view. The parts are between 0 (the mean light) and 1. They are
 * found among the trained photos: those with which the others of their run, and then their neighbours, predict them
 * best, by least squares, and 0 where that is not clear. So a light that changes from photo to photo stays at the mean,
 * a light that changes slowly along a walk follows its neighbours, and photos of a night have the light of a night.
 * views[n]; run[n]: see cn_runs_find; NULL: nothing is known of runs. width: at most CN_APPEARANCE_MAX. Sets nothing
 * where there is no memory. */
void cn_unseen_light(const cn_view *const *views, const float *run, uint32_t n, uint32_t n_trained, uint32_t width,
                     float *rows);
#endif
