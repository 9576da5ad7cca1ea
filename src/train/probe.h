/* Real training steps on a tile made up in memory: how long one takes on this machine. Private to train/. */
#ifndef CONURB_TRAIN_PROBE_H
#define CONURB_TRAIN_PROBE_H
#include "conurb/train.h"

/* Median seconds of a step with these options, the effects of `tile` that are on, and n_photos photos; about a second, longer where
 * steps are. Allocates what training allocates. CN_ERR_INTERRUPTED: ctx->stop. */
CN_NODISCARD cn_status cn_train_probe(const cn_context *ctx, const cn_train_options *options, const cn_plan_tile *tile, uint32_t n_photos,
                                      double *step_s);
#endif
