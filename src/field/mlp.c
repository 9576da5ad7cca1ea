#include "field/mlp.h"

#include "base/rng.h"

#include <math.h>

static uint32_t pad4(uint32_t n)
{
    return (n + 3u) & ~3u;
}

cn_status cn_mlp_layout(cn_mlp *mlp, uint32_t enc_rows, uint32_t density_width, uint32_t colour_width,
                        uint32_t conditioning)
{
    memset(mlp, 0, sizeof *mlp);
    const uint32_t widths[2] = { density_width, colour_width };
    for (int i = 0; i < 2; i++)
        if (widths[i] < 4 || widths[i] > 256 || widths[i] % 4)
            return cn_fail(CN_ERR_CONFIG, "field.%s is %u; give a multiple of 4 from 4 to 256",
                           i ? "colour_width" : "density_width", widths[i]);
    if (conditioning > 256)
        return cn_fail(CN_ERR_CONFIG, "%u values condition the colour, but 256 is the maximum", conditioning);
    mlp->enc_rows = pad4(enc_rows);
    mlp->density_width = density_width;
    mlp->colour_width = colour_width;
    mlp->colour_in = CN_GEO + pad4(conditioning);
    const uint32_t d = density_width, c = colour_width;
    const uint32_t shape[CN_LAYERS][2] = {
        { d, mlp->enc_rows }, { CN_GEO, d }, { c, mlp->colour_in }, { c, c }, { 4, c }
    };
    for (int i = 0; i < CN_LAYERS; i++) {
        mlp->layer[i] = (cn_layer){ shape[i][0], shape[i][1], mlp->n_weights };
        mlp->n_weights += (size_t)shape[i][0] * shape[i][1];
    }
    return CN_OK;
}

void cn_mlp_init(const cn_mlp *mlp, uint64_t seed, float *weights)
{
    for (int l = 0; l < CN_LAYERS; l++) {
        const cn_layer *layer = &mlp->layer[l];
        const float bound = sqrtf(6.0f / (float)layer->in);
        for (size_t i = 0; i < (size_t)layer->out * layer->in; i++)
            weights[layer->offset + i] = (2 * cn_rng_float(seed, 2, layer->offset + i) - 1) * bound;
    }
}

void cn_mlp_transpose(const cn_mlp *mlp, const float *weights, float *transposed)
{
    for (int l = 0; l < CN_LAYERS; l++) {
        const cn_layer *layer = &mlp->layer[l];
        for (uint32_t o = 0; o < layer->out; o++)
            for (uint32_t i = 0; i < layer->in; i++)
                transposed[layer->offset + (size_t)i * layer->out + o] =
                    weights[layer->offset + (size_t)o * layer->in + i];
    }
}

/* Floats of padding between two buffers. A layer reads one panel and writes another. If both had the same offset in a
 * page, loads would wait for unrelated stores (4K aliasing): a quarter of the time of a 64 x 64 layer. */
enum { STAGGER = 272 };

void cn_mlp_acts_take(const cn_mlp *mlp, cn_arena *arena, size_t n_panels, cn_field_acts *acts)
{
    float **const buffer[] = {
        &acts->enc, &acts->own[CN_MLP_HIDDEN], &acts->in, &acts->own[CN_MLP_COLOUR0], &acts->own[CN_MLP_COLOUR1],
        &acts->out
    };
    const uint32_t rows[] = {
        mlp->enc_rows, mlp->density_width, mlp->colour_in, mlp->colour_width, mlp->colour_width, 4
    };
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        *buffer[i] = CN_ARENA_NEW(arena, float, n_panels *CN_PANEL *rows[i] + STAGGER);
}

/* y = W x of one panel. */
static void forward(const cn_mlp *mlp, const cn_kernel *k, const float *transposed, int layer, const float *x, float *y,
                    bool relu)
{
    const cn_layer *l = &mlp->layer[layer];
    k->gemm((cn_matrix){ transposed + l->offset, l->out, l->in }, x, y, NULL, relu);
}

/* dx = W^T dy of one panel, zero where gate (the activation behind dx) is not positive. */
static void backward(const cn_mlp *mlp, const cn_kernel *k, const float *weights, int layer, const float *dy, float *dx,
                     const float *gate)
{
    const cn_layer *l = &mlp->layer[layer];
    k->gemm((cn_matrix){ weights + l->offset, l->in, l->out }, dy, dx, gate, false);
}

void cn_mlp_logits(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params, const cn_field_acts *acts,
                   const float *enc, size_t n_panels, float *logit)
{
    float *hidden = acts->own[CN_MLP_HIDDEN], *geo = acts->in;
    for (size_t p = 0; p < n_panels; p++) {
        forward(mlp, k, params->transposed, CN_LAYER_DENSITY0, enc + p * mlp->enc_rows * CN_PANEL, hidden, true);
        forward(mlp, k, params->transposed, CN_LAYER_DENSITY1, hidden, geo, false);
        memcpy(logit + p * CN_PANEL, geo, CN_PANEL * sizeof(float));
    }
}

void cn_mlp_geometry(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params, const cn_field_acts *acts,
                     size_t n_panels, float *geo)
{
    float *hidden = acts->own[CN_MLP_HIDDEN];
    for (size_t p = 0; p < n_panels; p++) {
        forward(mlp, k, params->transposed, CN_LAYER_DENSITY0, acts->enc + p * mlp->enc_rows * CN_PANEL, hidden, true);
        forward(mlp, k, params->transposed, CN_LAYER_DENSITY1, hidden, geo + p * CN_GEO * CN_PANEL, false);
    }
}

void cn_mlp_density(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params, const cn_field_acts *acts,
                    size_t n_panels)
{
    const size_t dw = mlp->density_width;
    for (size_t p = 0; p < n_panels; p++) {
        float *hidden = acts->own[CN_MLP_HIDDEN] + p * dw * CN_PANEL;
        forward(mlp, k, params->transposed, CN_LAYER_DENSITY0, acts->enc + p * mlp->enc_rows * CN_PANEL, hidden, true);
        forward(mlp, k, params->transposed, CN_LAYER_DENSITY1, hidden, acts->in + p * mlp->colour_in * CN_PANEL, false);
    }
}

void cn_mlp_colour(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params, const cn_field_acts *acts,
                   size_t n_panels)
{
    const size_t cw = mlp->colour_width;
    for (size_t p = 0; p < n_panels; p++) {
        float *c0 = acts->own[CN_MLP_COLOUR0] + p * cw * CN_PANEL, *c1 = acts->own[CN_MLP_COLOUR1] + p * cw * CN_PANEL;
        forward(mlp, k, params->transposed, CN_LAYER_COLOUR0, acts->in + p * mlp->colour_in * CN_PANEL, c0, true);
        forward(mlp, k, params->transposed, CN_LAYER_COLOUR1, c0, c1, true);
        forward(mlp, k, params->transposed, CN_LAYER_COLOUR2, c1, acts->out + p * 4 * CN_PANEL, false);
    }
}

static void weight_grad(const cn_mlp *mlp, const cn_kernel *k, int layer, const float *dy, size_t dy_rows,
                        const float *x, size_t n_panels, float *dw)
{
    const cn_layer *l = &mlp->layer[layer];
    k->weight_grad(&(cn_panel_rows){ dy, dy_rows * CN_PANEL, l->out },
                   &(cn_panel_rows){ x, (size_t)l->in * CN_PANEL, l->in }, n_panels, dw + l->offset);
}

/* A few panels are processed at a time, so that a layer's output is still in cache when the weight gradients read it.
 */
enum { CHUNK = 4 };

void cn_mlp_backward(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params, const cn_field_acts *acts,
                     const cn_field_acts *d, const float *d_logit, size_t n_panels, float *dw)
{
    const size_t width = mlp->colour_width * (size_t)CN_PANEL, in = mlp->colour_in * (size_t)CN_PANEL;
    const size_t hidden = mlp->density_width * (size_t)CN_PANEL, enc = mlp->enc_rows * (size_t)CN_PANEL;
    for (size_t first = 0; first < n_panels; first += CHUNK) {
        const size_t n = n_panels - first < CHUNK ? n_panels - first : CHUNK;
        for (size_t p = first; p < first + n; p++) {
            backward(mlp, k, params->weights, CN_LAYER_COLOUR2, d->out + p * 4 * CN_PANEL,
                     d->own[CN_MLP_COLOUR1] + p * width, acts->own[CN_MLP_COLOUR1] + p * width);
            backward(mlp, k, params->weights, CN_LAYER_COLOUR1, d->own[CN_MLP_COLOUR1] + p * width,
                     d->own[CN_MLP_COLOUR0] + p * width, acts->own[CN_MLP_COLOUR0] + p * width);
            backward(mlp, k, params->weights, CN_LAYER_COLOUR0, d->own[CN_MLP_COLOUR0] + p * width, d->in + p * in,
                     NULL);
            for (int lane = 0; lane < CN_PANEL; lane++)
                d->in[p * in + lane] += d_logit[p * CN_PANEL + lane];
            backward(mlp, k, params->weights, CN_LAYER_DENSITY1, d->in + p * in, d->own[CN_MLP_HIDDEN] + p * hidden,
                     acts->own[CN_MLP_HIDDEN] + p * hidden);
            backward(mlp, k, params->weights, CN_LAYER_DENSITY0, d->own[CN_MLP_HIDDEN] + p * hidden, d->enc + p * enc,
                     NULL);
        }
        weight_grad(mlp, k, CN_LAYER_COLOUR2, d->out + first * 4 * CN_PANEL, 4,
                    acts->own[CN_MLP_COLOUR1] + first * width, n, dw);
        weight_grad(mlp, k, CN_LAYER_COLOUR1, d->own[CN_MLP_COLOUR1] + first * width, mlp->colour_width,
                    acts->own[CN_MLP_COLOUR0] + first * width, n, dw);
        weight_grad(mlp, k, CN_LAYER_COLOUR0, d->own[CN_MLP_COLOUR0] + first * width, mlp->colour_width,
                    acts->in + first * in, n, dw);
        weight_grad(mlp, k, CN_LAYER_DENSITY1, d->in + first * in, mlp->colour_in,
                    acts->own[CN_MLP_HIDDEN] + first * hidden, n, dw);
        weight_grad(mlp, k, CN_LAYER_DENSITY0, d->own[CN_MLP_HIDDEN] + first * hidden, mlp->density_width,
                    acts->enc + first * enc, n, dw);
    }
}

void cn_mlp_colour_backward(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params,
                            const cn_field_acts *acts, const cn_field_acts *d, size_t n_panels)
{
    const size_t width = mlp->colour_width * (size_t)CN_PANEL, in = mlp->colour_in * (size_t)CN_PANEL;
    for (size_t p = 0; p < n_panels; p++) {
        backward(mlp, k, params->weights, CN_LAYER_COLOUR2, d->out + p * 4 * CN_PANEL,
                 d->own[CN_MLP_COLOUR1] + p * width, acts->own[CN_MLP_COLOUR1] + p * width);
        backward(mlp, k, params->weights, CN_LAYER_COLOUR1, d->own[CN_MLP_COLOUR1] + p * width,
                 d->own[CN_MLP_COLOUR0] + p * width, acts->own[CN_MLP_COLOUR0] + p * width);
        backward(mlp, k, params->weights, CN_LAYER_COLOUR0, d->own[CN_MLP_COLOUR0] + p * width, d->in + p * in, NULL);
    }
}
