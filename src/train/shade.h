/* Shading of a group of rays: the effects' conditioning, the colours, the composites, the loss, and the backward
 * pass of all of it. Training and fits use the same code. Private to train/. */
#ifndef CONURB_TRAIN_SHADE_H
#define CONURB_TRAIN_SHADE_H
#include "train/stats.h"
#include "train/worker.h"

typedef struct cn_shade {
    const cn_kernel *kernel;
    const cn_field *field;
    cn_field_params params;
    const cn_effect_pack *pack;
    cn_effect_state effects;
    cn_effect_rays rays; /* at most CN_GROUP */
    const float *target; /* [rays][4] linear ACEScg and weight; a ray of weight 0 takes no part */
    float scale;         /* of a ray's loss: 1 / (3 rays of the step) */
    bool charbonnier;    /* large errors count less than by their squares */
    float *error;        /* [rays] each ray's squared error; NULL: not asked for */
} cn_shade;

/* Gradients of a group's composited colours, and of the transmittance that is left at each ray's end. */
typedef struct cn_shade_grad {
    float pixel[CN_GROUP][3], after[CN_GROUP];
} cn_shade_grad;

/* Computes the effects' conditioning (a row for each ray), copies it to the live samples, and computes their colours.
 */
void cn_shade_forward(const cn_shade *shade, uint32_t n_live, cn_worker *worker);
/* What the live samples of a ray show together. */
void cn_shade_composite(const cn_span *span, const cn_worker *worker, float rgb[3]);
/* Composites the rays and computes the loss. Sets grad. Adds the gradients of the effects' own parameters to
 * effect_grad. */
void cn_shade_loss(const cn_shade *shade, const cn_span *spans, cn_worker *worker, cn_shade_grad *grad,
                   const cn_effect_grad *effect_grad, cn_step_stats *stats);
/* The same from the composited colours on, which grad->pixel holds. after: transmittance at each ray's end. saved: the
 * effects' saved activations. */
void cn_shade_pixels(const cn_shade *shade, const float *after, float *saved, cn_shade_grad *grad,
                     const cn_effect_grad *effect_grad, cn_step_stats *stats);
/* Gradients of the colour head's output (worker->d.out) of a ray's live samples, from those of the pixel and of the
 * samples themselves (worker->d_colour). */
void cn_shade_colours_backward(const cn_span *span, const float d_pixel[3], cn_worker *worker);
/* From the gradient of the colour head's input to the effects' parameters. */
void cn_shade_conditioning_backward(const cn_shade *shade, uint32_t n_live, cn_worker *worker,
                                    const cn_effect_grad *grad);
/* Zeroes what the last panel holds past the last live sample. */
void cn_shade_clear_tail(const cn_field *field, uint32_t n_live, cn_worker *worker);
#endif
