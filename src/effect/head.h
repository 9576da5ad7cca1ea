/* A small MLP over a batch of rays: two hidden layers with ReLU, without biases, run by the field's kernels. */
#ifndef CONURB_EFFECT_HEAD_H
#define CONURB_EFFECT_HEAD_H
#include "effect/effect.h"

/* Widths, each a multiple of 4. */
typedef struct cn_head {
    uint32_t in, width, out;
} cn_head;

#define CN_HEAD_WEIGHTS(in, width, out) ((width) * (in) + (width) * (width) + (out) * (width))
/* Saved floats for each ray: activations, and their gradients. */
#define CN_HEAD_SAVED(in, width, out) (2 * ((in) + 2 * (width) + (out)))

/* Where the activations are in the saved floats, each [panel][row][CN_PANEL]. */
typedef struct cn_head_acts {
    float *in, *h0, *h1, *out, *d_in, *d_h0, *d_h1, *d_out;
} cn_head_acts;
cn_head_acts cn_head_split(const cn_head *head, float *saved);
/* Element of row r of ray i in a buffer of `rows` rows. */
static inline float *cn_head_at(float *buffer, uint32_t rows, uint32_t r, uint32_t i)
{
    return buffer + ((size_t)(i / CN_PANEL) * rows + r) * CN_PANEL + i % CN_PANEL;
}

/* Uniform first weights (He et al. 2015), row-major [out][in], layer after layer. Those of the last layer are a tenth
 * of that. */
void cn_head_init(const cn_head *head, uint64_t seed, uint32_t stream, float *weights);
/* Transposes each matrix. The offsets stay. */
void cn_head_transpose(const cn_head *head, const float *weights, float *transposed);
/* Computes acts->out from acts->in for n rays. Zeroes the lanes after the last ray. */
void cn_head_forward(const cn_head *head, const cn_kernel *kernel, const float *transposed, uint32_t n,
                     const cn_head_acts *acts);
/* Computes acts->d_in from acts->d_out, and adds the gradients of the weights to d_weights. Zeroes the lanes after the
 * last ray. */
void cn_head_backward(const cn_head *head, const cn_kernel *kernel, const float *weights, uint32_t n,
                      const cn_head_acts *acts, float *d_weights);
#endif
