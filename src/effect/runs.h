/* Capture runs: photos of one flight or one drive, told apart by when they were taken. */
#ifndef CONURB_EFFECT_RUNS_H
#define CONURB_EFFECT_RUNS_H
#include "conurb/photo.h"

/* When a photo was taken, as a constant of its row: seconds, exact to two minutes; NaN where it does not say. */
float cn_run_time(const cn_photo *photo);
/* The times of n photos, `stride` floats apart, become their runs in place: 1, 2, ... in order of time, split where
 * nothing was taken for half an hour; 0 where time is unknown or there is one run only. Returns how many runs there
 * are. */
uint32_t cn_runs_find(float *times, size_t stride, uint32_t n);
/* Photos of one run have one sun and one sky: what a step draws their codes together by. Else a code is learned only
 * where its own photo looked, and says nothing of what its light does elsewhere. */
#define CN_RUN_DRAW 0.03f
/* Moves rows of `width` floats, `stride` apart, the given part of the way to the mean of their run (run[n], as from
 * cn_runs_find); those of no run stay. */
void cn_runs_draw(const float *run, uint32_t n, float *rows, size_t stride, uint32_t width, float part);
#endif
