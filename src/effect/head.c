#include "effect/head.h"

#include "base/rng.h"

#include <math.h>

/* Layer l: outputs, inputs and where its weights begin. */
typedef struct layer {
    uint32_t out, in, offset;
} layer;
static void layers_of(const cn_head *h, layer l[3])
{
    l[0] = (layer){ h->width, h->in, 0 };
    l[1] = (layer){ h->width, h->width, h->width * h->in };
    l[2] = (layer){ h->out, h->width, h->width * h->in + h->width * h->width };
}

cn_head_acts cn_head_split(const cn_head *h, float *saved)
{
    cn_head_acts a;
    float **at[8] = { &a.in, &a.h0, &a.h1, &a.out, &a.d_in, &a.d_h0, &a.d_h1, &a.d_out };
    const uint32_t rows[4] = { h->in, h->width, h->width, h->out };
    for (int i = 0; i < 8; i++) {
        *at[i] = saved;
        saved += (size_t)rows[i % 4] * CN_EFFECT_RAYS;
    }
    return a;
}

void cn_head_init(const cn_head *head, uint64_t seed, uint32_t stream, float *weights)
{
    layer l[3];
    layers_of(head, l);
    for (int i = 0; i < 3; i++) {
        const float bound = sqrtf(6.0f / (float)l[i].in) * (i == 2 ? 0.1f : 1);
        for (uint32_t k = l[i].offset; k < l[i].offset + l[i].out * l[i].in; k++)
            weights[k] = (2 * cn_rng_float(seed, stream, k) - 1) * bound;
    }
}

void cn_head_transpose(const cn_head *head, const float *weights, float *transposed)
{
    layer l[3];
    layers_of(head, l);
    for (int i = 0; i < 3; i++)
        for (uint32_t o = 0; o < l[i].out; o++)
            for (uint32_t k = 0; k < l[i].in; k++)
                transposed[l[i].offset + k * l[i].out + o] = weights[l[i].offset + o * l[i].in + k];
}

static void clear_tail(float *buffer, uint32_t rows, uint32_t n)
{
    for (uint32_t i = n; i % CN_PANEL; i++)
        for (uint32_t r = 0; r < rows; r++)
            *cn_head_at(buffer, rows, r, i) = 0;
}

static uint32_t panels_of(uint32_t n)
{
    return (n + CN_PANEL - 1) / CN_PANEL;
}

void cn_head_forward(const cn_head *head, const cn_kernel *kernel, const float *transposed, uint32_t n,
                     const cn_head_acts *acts)
{
    layer l[3];
    layers_of(head, l);
    float *const x[4] = { acts->in, acts->h0, acts->h1, acts->out };
    clear_tail(acts->in, head->in, n);
    for (uint32_t p = 0; p < panels_of(n); p++)
        for (int i = 0; i < 3; i++)
            kernel->gemm((cn_matrix){ transposed + l[i].offset, l[i].out, l[i].in },
                         x[i] + (size_t)p * l[i].in * CN_PANEL, x[i + 1] + (size_t)p * l[i].out * CN_PANEL, NULL,
                         i < 2);
}

void cn_head_backward(const cn_head *head, const cn_kernel *kernel, const float *weights, uint32_t n,
                      const cn_head_acts *acts, float *d_weights)
{
    layer l[3];
    layers_of(head, l);
    float *const x[4] = { acts->in, acts->h0, acts->h1, acts->out }, *const d[4] = { acts->d_in, acts->d_h0, acts->d_h1,
                                                                                     acts->d_out };
    clear_tail(acts->d_out, head->out, n);
    for (int i = 2; i >= 0; i--) {
        const size_t in = (size_t)l[i].in * CN_PANEL, out = (size_t)l[i].out * CN_PANEL;
        for (uint32_t p = 0; p < panels_of(n); p++)
            kernel->gemm((cn_matrix){ weights + l[i].offset, l[i].in, l[i].out }, d[i + 1] + p * out, d[i] + p * in,
                         i ? x[i] + p * in : NULL, false);
        kernel->weight_grad(&(cn_panel_rows){ d[i + 1], out, l[i].out }, &(cn_panel_rows){ x[i], in, l[i].in },
                            panels_of(n), d_weights + l[i].offset);
    }
}
