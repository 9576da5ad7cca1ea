/* What one step did. Private to train/. */
#ifndef CONURB_TRAIN_STATS_H
#define CONURB_TRAIN_STATS_H
#include <stdint.h>

typedef struct cn_step_stats {
    double squared_error;         /* sum over rays and channels, display-encoded */
    double weighed_error, weight; /* that sum with the rays weighed as the loss weighs them; the sum of the weights */
    uint64_t rays, samples, live; /* live: samples with a weight worth a gradient */
    uint64_t bad;                 /* rays left out because something was not finite */
    double gradient;              /* sum of the squares of all gradients */
    /* Of the photos' display-encoded colours: sums, sums of squares, how many; 0 where no device has summed them. */
    double colour[3], colour_squared[3], colours;
} cn_step_stats;
#endif
