/* Measures how long a training step takes on this machine, with real steps on a tile made in memory. Private to
 * train/. */
#ifndef CONURB_TRAIN_PROBE_H
#define CONURB_TRAIN_PROBE_H
#include "conurb/train.h"

/* Median seconds of a step with these options, the effects of `tile` that are on, and n_photos photos, if all of its
 * samples were live. Takes as long as about 70 steps, and as much memory as training. CN_ERR_INTERRUPTED: ctx->stop.
 */
CN_NODISCARD cn_status cn_train_probe(const cn_context *ctx, const cn_train_options *options, const cn_plan_tile *tile,
                                      uint32_t n_photos, double *full_s);
/* The part of a step's time that is proportional to its live samples (the colour head and the backward pass). The rest
 * is proportional to all samples. */
#define CN_LIVE_PART 0.7
/* The time of a step of this tile, over its time if all samples were live. The share of live samples falls with the
 * depth of the space that rays march through: 0.98, 0.78 and 0.42 of them at far / near of 4.5, 32 and 1000 (aerial,
 * facades, an object indoors). */
double cn_train_live_part(const cn_plan_tile *tile);
#endif
