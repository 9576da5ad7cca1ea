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

/* W of a layer, for y = W x of one panel. */
static cn_matrix forward(const cn_mlp *mlp, const float *transposed, int layer)
{
    const cn_layer *l = &mlp->layer[layer];
    return (cn_matrix){ transposed + l->offset, l->out, l->in };
}
/* Its transpose, for dx = W^T dy, which is zero where the gate (the activation behind dx) is not positive. */
static cn_matrix backward(const cn_mlp *mlp, const float *weights, int layer)
{
    const cn_layer *l = &mlp->layer[layer];
    return (cn_matrix){ weights + l->offset, l->in, l->out };
}

void cn_mlp_logits(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params, const cn_field_acts *acts,
                   size_t n_panels, float *logit)
{
    float *hidden = acts->own[CN_MLP_HIDDEN], *geo = acts->in;
    for (size_t p = 0; p < n_panels; p++) {
        k->gemm(forward(mlp, params->transposed, CN_LAYER_DENSITY0), acts->enc + p * mlp->enc_rows * CN_PANEL, hidden,
                NULL, true);
        k->gemm(forward(mlp, params->transposed, CN_LAYER_DENSITY1), hidden, geo, NULL, false);
        memcpy(logit + p * CN_PANEL, geo, CN_PANEL * sizeof(float));
    }
}

void cn_mlp_geometry(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params, const cn_field_acts *acts,
                     size_t n_panels, float *geo)
{
    float *hidden = acts->own[CN_MLP_HIDDEN];
    for (size_t p = 0; p < n_panels; p++) {
        k->gemm(forward(mlp, params->transposed, CN_LAYER_DENSITY0), acts->enc + p * mlp->enc_rows * CN_PANEL, hidden,
                NULL, true);
        k->gemm(forward(mlp, params->transposed, CN_LAYER_DENSITY1), hidden, geo + p * CN_GEO * CN_PANEL, NULL, false);
    }
}

void cn_mlp_density(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params, const cn_field_acts *acts,
                    size_t n_panels)
{
    const size_t dw = mlp->density_width;
    for (size_t p = 0; p < n_panels; p++) {
        float *hidden = acts->own[CN_MLP_HIDDEN] + p * dw * CN_PANEL;
        k->gemm(forward(mlp, params->transposed, CN_LAYER_DENSITY0), acts->enc + p * mlp->enc_rows * CN_PANEL, hidden,
                NULL, true);
        k->gemm(forward(mlp, params->transposed, CN_LAYER_DENSITY1), hidden, acts->in + p * mlp->colour_in * CN_PANEL,
                NULL, false);
    }
}

void cn_mlp_colour(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params, const cn_field_acts *acts,
                   size_t n_panels)
{
    const size_t cw = mlp->colour_width;
    for (size_t p = 0; p < n_panels; p++) {
        float *c0 = acts->own[CN_MLP_COLOUR0] + p * cw * CN_PANEL, *c1 = acts->own[CN_MLP_COLOUR1] + p * cw * CN_PANEL;
        k->gemm(forward(mlp, params->transposed, CN_LAYER_COLOUR0), acts->in + p * mlp->colour_in * CN_PANEL, c0, NULL,
                true);
        k->gemm(forward(mlp, params->transposed, CN_LAYER_COLOUR1), c0, c1, NULL, true);
        k->gemm(forward(mlp, params->transposed, CN_LAYER_COLOUR2), c1, acts->out + p * 4 * CN_PANEL, NULL, false);
    }
}

/* dy and x: where the rows of the layer's outputs and inputs are. */
static void weight_grad(const cn_layer *l, const cn_kernel *k, cn_panel_rows dy, cn_panel_rows x, size_t n_panels,
                        float *dw)
{
    dy.n = l->out;
    x.n = l->in;
    k->weight_grad(&dy, &x, n_panels, dw + l->offset);
}

/* A few panels are processed at a time, so that a layer's output is still in cache when the weight gradients read it.
 */
enum { CHUNK = 4 };

void cn_mlp_backward(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params, const cn_field_acts *acts,
                     const cn_field_gradient *d, size_t n_panels)
{
    const cn_field_acts *of = d->acts;
    const size_t width = mlp->colour_width * (size_t)CN_PANEL, in = mlp->colour_in * (size_t)CN_PANEL;
    const size_t hidden = mlp->density_width * (size_t)CN_PANEL, enc = mlp->enc_rows * (size_t)CN_PANEL;
    for (size_t first = 0; first < n_panels; first += CHUNK) {
        const size_t n = n_panels - first < CHUNK ? n_panels - first : CHUNK;
        for (size_t p = first; p < first + n; p++) {
            k->gemm(backward(mlp, params->weights, CN_LAYER_COLOUR2), of->out + p * 4 * CN_PANEL,
                    of->own[CN_MLP_COLOUR1] + p * width, acts->own[CN_MLP_COLOUR1] + p * width, false);
            k->gemm(backward(mlp, params->weights, CN_LAYER_COLOUR1), of->own[CN_MLP_COLOUR1] + p * width,
                    of->own[CN_MLP_COLOUR0] + p * width, acts->own[CN_MLP_COLOUR0] + p * width, false);
            k->gemm(backward(mlp, params->weights, CN_LAYER_COLOUR0), of->own[CN_MLP_COLOUR0] + p * width,
                    of->in + p * in, NULL, false);
            for (int lane = 0; lane < CN_PANEL; lane++)
                of->in[p * in + lane] += d->logit[p * CN_PANEL + lane];
            k->gemm(backward(mlp, params->weights, CN_LAYER_DENSITY1), of->in + p * in,
                    of->own[CN_MLP_HIDDEN] + p * hidden, acts->own[CN_MLP_HIDDEN] + p * hidden, false);
            k->gemm(backward(mlp, params->weights, CN_LAYER_DENSITY0), of->own[CN_MLP_HIDDEN] + p * hidden,
                    of->enc + p * enc, NULL, false);
        }
        const cn_layer *l = mlp->layer;
        weight_grad(&l[CN_LAYER_COLOUR2], k, (cn_panel_rows){ of->out + first * 4 * CN_PANEL, 4 * CN_PANEL, 0 },
                    (cn_panel_rows){ acts->own[CN_MLP_COLOUR1] + first * width, width, 0 }, n, d->weights);
        weight_grad(&l[CN_LAYER_COLOUR1], k, (cn_panel_rows){ of->own[CN_MLP_COLOUR1] + first * width, width, 0 },
                    (cn_panel_rows){ acts->own[CN_MLP_COLOUR0] + first * width, width, 0 }, n, d->weights);
        weight_grad(&l[CN_LAYER_COLOUR0], k, (cn_panel_rows){ of->own[CN_MLP_COLOUR0] + first * width, width, 0 },
                    (cn_panel_rows){ acts->in + first * in, in, 0 }, n, d->weights);
        weight_grad(&l[CN_LAYER_DENSITY1], k, (cn_panel_rows){ of->in + first * in, in, 0 },
                    (cn_panel_rows){ acts->own[CN_MLP_HIDDEN] + first * hidden, hidden, 0 }, n, d->weights);
        weight_grad(&l[CN_LAYER_DENSITY0], k, (cn_panel_rows){ of->own[CN_MLP_HIDDEN] + first * hidden, hidden, 0 },
                    (cn_panel_rows){ acts->enc + first * enc, enc, 0 }, n, d->weights);
    }
}

void cn_mlp_colour_backward(const cn_mlp *mlp, const cn_kernel *k, const cn_mlp_params *params,
                            const cn_field_acts *acts, const cn_field_acts *d, size_t n_panels)
{
    const size_t width = mlp->colour_width * (size_t)CN_PANEL, in = mlp->colour_in * (size_t)CN_PANEL;
    for (size_t p = 0; p < n_panels; p++) {
        k->gemm(backward(mlp, params->weights, CN_LAYER_COLOUR2), d->out + p * 4 * CN_PANEL,
                d->own[CN_MLP_COLOUR1] + p * width, acts->own[CN_MLP_COLOUR1] + p * width, false);
        k->gemm(backward(mlp, params->weights, CN_LAYER_COLOUR1), d->own[CN_MLP_COLOUR1] + p * width,
                d->own[CN_MLP_COLOUR0] + p * width, acts->own[CN_MLP_COLOUR0] + p * width, false);
        k->gemm(backward(mlp, params->weights, CN_LAYER_COLOUR0), d->own[CN_MLP_COLOUR0] + p * width, d->in + p * in,
                NULL, false);
    }
}
