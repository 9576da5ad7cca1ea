/* A small MLP over a batch of rays: two hidden layers with ReLU, without biases, run by the field's kernels. */
#ifndef CONURB_EFFECT_HEAD_H
#define CONURB_EFFECT_HEAD_H
#include "effect/effect.h"

/* Widths, each a multiple of 4. */
typedef struct cn_head {
    uint32_t in, width, out;
} cn_head;

#define CN_HEAD_WEIGHTS(in, width, out) ((width) * (in) + (width) * (width) + (out) * (width))
/* Floats a ray of keep: activations, and gradients of the same. */
#define CN_HEAD_SAVED(in, width, out) (2 * ((in) + 2 * (width) + (out)))

/* Where the activations lie in keep, each [panel][row][CN_PANEL]. */
typedef struct cn_head_acts {
    float *in, *h0, *h1, *out, *d_in, *d_h0, *d_h1, *d_out;
} cn_head_acts;
cn_head_acts cn_head_split(const cn_head *head, float *saved);
/* Element of row r of ray i in a buffer of `rows` rows. */
static inline float *cn_head_at(float *buffer, uint32_t rows, uint32_t r, uint32_t i)
{
    return buffer + ((size_t)(i / CN_PANEL) * rows + r) * CN_PANEL + i % CN_PANEL;
}

/* Weights uniform by He, row-major [out][in], layer after layer; the last layer's are a tenth of that. */
void cn_head_init(const cn_head *head, uint64_t seed, uint32_t stream, float *weights);
/* The same, each matrix transposed, at the same offsets. */
void cn_head_transpose(const cn_head *head, const float *weights, float *transposed);
/* acts->in of n rays to acts->out. Lanes past the last ray are zeroed. */
void cn_head_forward(const cn_head *head, const cn_kernel *kernel, const float *transposed, uint32_t n,
                     const cn_head_acts *acts);
/* acts->d_out to acts->d_in; weight gradients are added to d_weights. Lanes past the last ray are zeroed. */
void cn_head_backward(const cn_head *head, const cn_kernel *kernel, const float *weights, uint32_t n,
                      const cn_head_acts *acts, float *d_weights);
#endif
