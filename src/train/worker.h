/* Scratch memory of one thread: the samples of its group of rays. Private to train/. */
#ifndef CONURB_TRAIN_WORKER_H
#define CONURB_TRAIN_WORKER_H
#include "effect/effect.h"
#include "field/field.h"
#include "train/parameters.h"

/* Live samples are those whose weight is large enough for a gradient. Arrays have room for CN_GROUP_CAP. */
typedef struct cn_worker {
    cn_field_acts acts, d;
    float *logit, *d_logit;
    /* Of live samples: weight, transmittance behind, gradient of the optical thickness by the logit. */
    float *weight, *behind, *tau_gradient;
    float *d_weight, *log_distance;       /* of live samples */
    float *d_colour;                      /* [cap][3] of single samples, beside what the pixels give */
    uint8_t *single_view;                 /* of live samples; NULL where no effect asks for multi-view support */
    uint32_t *live, *live_ray;            /* their place among the group's samples; their ray in the group */
    float *colour;                        /* [cap][3] */
    float *conditioning, *d_conditioning; /* [CN_GROUP][field->conditioning] */
    float (*d_pos)[3];                    /* [cap], where an effect moves rays */
    float *saved;                         /* the effects' saved activations */
    cn_part_scratch part;
} cn_worker;

/* A ray: where its live samples are in the worker's arrays, the sum of their weights, and the transmittance at its
 * end. */
typedef struct cn_span {
    uint32_t first, n;
    float total, after;
} cn_span;

void cn_worker_carve(const cn_field *field, const cn_effect_pack *pack, cn_arena *arena, cn_worker *worker);
#endif
