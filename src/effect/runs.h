/* Capture runs: photos of one flight or one drive, told apart by when they were taken. */
#ifndef CONURB_EFFECT_RUNS_H
#define CONURB_EFFECT_RUNS_H
#include "conurb/photo.h"

/* The time at which a photo was taken, as a constant of its row: seconds, exact to two minutes; NaN where it is
 * unknown. */
float cn_run_time(const cn_photo *photo);
/* Replaces the times of n photos, `stride` floats apart, by the numbers of their runs: 1, 2, ... in order of time. A
 * pause of half an hour without a photo begins a new run. 0: the time is unknown. Returns the number of runs, at
 * least 1. */
uint32_t cn_runs_find(float *times, size_t stride, uint32_t n);
/* The same for photos of which the first n_trained are trained on. These alone make the runs, so that they are those of
 * training, whatever is held out. Another photo is of the run of a trained one within half an hour, the nearest; -1:
 * there is none. */
uint32_t cn_runs_find_trained(float *times, size_t stride, uint32_t n, uint32_t n_trained);
/* Photos of one run share one sun and one sky. Each step of training pulls their codes together by this part.
 * Otherwise a code learns only what its own photo shows, and nothing about the rest of the scene in that light.
 * Tuned on the synthetic city (192 photos, 6000 steps): held-out views in the light of another run 21.98 dB, and
 * 21.79 without it. */
#define CN_RUN_DRAW 0.03f
/* Whether photos are of more than one run. */
bool cn_runs_differ(const float *run, uint32_t n);
/* Moves rows of `width` floats, `stride` apart, towards the mean of their run (run[n], from cn_runs_find), by the
 * given part of the way. Rows without a run stay. */
void cn_runs_draw(const float *run, uint32_t n, float *rows, size_t stride, uint32_t width, float part);
#endif
