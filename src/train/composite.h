/* Compositing of a ray's samples: densities, transmittance, the live samples, and the way back. Private to train/. */
#ifndef CONURB_TRAIN_COMPOSITE_H
#define CONURB_TRAIN_COMPOSITE_H
#include "train/worker.h"

#define CN_SPREAD_LOSS 0.01f /* weight of the variance of log-distance of a ray's samples: fog becomes surface */
/* Weight of its mean deviation, times the prior weight. It still costs fog where the variance is next to nothing. */
#define CN_BLUR_LOSS 0.003f
/* Weight of the variance about a sparse point that the ray goes through (after Deng et al. 2022, "DS-NeRF"). */
#define CN_SPARSE_LOSS 0.1f
#define CN_SPARSE_BLUR_LOSS 0.2f /* of the mean deviation from it */

/* The live samples of a group: from logits to weights; enc and pos of these move together. seen may be NULL. */
uint32_t cn_composite_gather(const cn_field *field, const uint32_t *ray_samples, uint32_t n_rays, const float *length,
                             float *enc, float *pos, float *seen, cn_worker *worker, cn_span *spans);
/* Gradients of the density logits of one ray's live samples from those of its pixel and of what is left at its end,
 * with what the spread of its matter costs. t_at: distances of all samples of the ray's group; sparse: distance of the
 * sparse point that it goes through, 0 for none; scale: of a ray's loss; prior_weight: cn_monitor_prior_weight. */
void cn_composite_backward(const cn_span *span, const float d_pixel[3], float d_after, const float *t_at, float sparse,
                           float scale, float prior_weight, cn_worker *worker);
#endif
