/* Compositing of a ray's samples: densities, transmittance, the live samples, and the backward pass. Private to
 * train/. */
#ifndef CONURB_TRAIN_COMPOSITE_H
#define CONURB_TRAIN_COMPOSITE_H
#include "train/worker.h"

/* The samples of a group of rays, ray after ray. */
typedef struct cn_composite_samples {
    uint32_t n_rays;
    const uint32_t *of_ray; /* [n_rays] how many samples each ray has */
    const float *length;
    float *enc, *pos; /* panels */
    uint32_t others;  /* besides the live samples, every so many-th of the rest before a ray's end; 0: none */
    float *seen;      /* is set: how much of each sample is seen, for the occupancy; NULL: not asked for */
} cn_composite_samples;

/* Finds the live samples of a group and their weights from the logits, and moves their enc and pos together. Returns
 * how many there are. */
uint32_t cn_composite_gather(const cn_field *field, const cn_composite_samples *samples, cn_worker *worker,
                             cn_span *spans);
/* Gradients of the density logits of one ray's live samples, from those of their weights (worker->d_weight) and of the
 * transmittance that is left at the ray's end. */
void cn_composite_backward(const cn_span *span, float d_after, cn_worker *worker);
#endif
