/* Compositing of a ray's samples: densities, transmittance, the live samples, and the way back. Private to train/. */
#ifndef CONURB_TRAIN_COMPOSITE_H
#define CONURB_TRAIN_COMPOSITE_H
#include "train/worker.h"

/* The live samples of a group: from logits to weights; enc and pos of these move together. seen may be NULL. */
uint32_t cn_composite_gather(const cn_field *field, const uint32_t *ray_samples, uint32_t n_rays, const float *length,
                             float *enc, float *pos, float *seen, cn_worker *worker, cn_span *spans);
/* Gradients of the density logits of one ray's live samples, from those of their weights (worker->d_weight) and of the
 * transmittance that is left at the ray's end. */
void cn_composite_backward(const cn_span *span, float d_after, cn_worker *worker);
#endif
