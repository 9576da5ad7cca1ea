#include "field/field.h"

#include "base/rng.h"

#include <math.h>

static uint32_t pad4(uint32_t n)
{
    return (n + 3u) & ~3u;
}

static cn_status check(const cn_field_config *c)
{
    if (c->levels < 1 || c->levels > CN_MAX_LEVELS)
        return cn_fail(CN_ERR_CONFIG, "train.levels is %u; give 1 to %d", c->levels, CN_MAX_LEVELS);
    if (c->log2_table < 8 || c->log2_table > 24)
        return cn_fail(CN_ERR_CONFIG, "train.log2_table is %u; give 8 to 24", c->log2_table);
    if (c->base_resolution < 2 || c->finest_resolution < c->base_resolution || c->finest_resolution > 1u << 20)
        return cn_fail(CN_ERR_CONFIG, "hash grid resolutions %u to %u; give 2 <= base <= finest <= 1048576",
                       c->base_resolution, c->finest_resolution);
    const uint32_t widths[2] = { c->density_width, c->colour_width };
    for (int i = 0; i < 2; i++)
        if (widths[i] < 4 || widths[i] > 256 || widths[i] % 4)
            return cn_fail(CN_ERR_CONFIG, "MLP width %u; give a multiple of 4 from 4 to 256", widths[i]);
    if (c->columns > 256) return cn_fail(CN_ERR_CONFIG, "%u effect columns; at most 256", c->columns);
    return CN_OK;
}

cn_status cn_field_layout(cn_field *field, const cn_field_config *config)
{
    CN_TRY(check(config));
    memset(field, 0, sizeof *field);
    field->config = *config;
    const double growth = config->levels > 1 ? pow((double)config->finest_resolution / config->base_resolution,
                                                   1.0 / (config->levels - 1))
                                             : 1;
    for (uint32_t l = 0; l < config->levels; l++) {
        cn_level *level = &field->level[l];
        level->resolution = (uint32_t)floor(config->base_resolution * pow(growth, l) + 1e-6);
        const double side = level->resolution + 2.0, dense = side * side * side;
        level->hashed = dense > (double)(1u << config->log2_table);
        /* Dense levels are padded to a multiple of 4 entries, so that every level starts on 8 floats. */
        level->entries = level->hashed ? 1u << config->log2_table : pad4((uint32_t)dense);
        level->offset = (uint32_t)field->entries;
        field->entries += level->entries;
    }
    field->enc_rows = pad4(2 * config->levels);
    field->columns = pad4(config->columns);
    field->colour_in = CN_GEO + field->columns;
    const uint32_t d = config->density_width, c = config->colour_width;
    const uint32_t shape[CN_LAYERS][2] = {
        { d, field->enc_rows }, { CN_GEO, d }, { c, field->colour_in }, { c, c }, { 4, c }
    };
    for (int i = 0; i < CN_LAYERS; i++) {
        field->layer[i] = (cn_layer){ shape[i][0], shape[i][1], field->n_weights };
        field->n_weights += (size_t)shape[i][0] * shape[i][1];
    }
    return CN_OK;
}

void cn_field_init(const cn_field *field, uint64_t seed, float *table, float *weights)
{
    for (size_t i = 0; i < 2 * field->entries; i++)
        table[i] = (2 * cn_rng_float(seed, 1, i) - 1) * 1e-4f;
    for (int l = 0; l < CN_LAYERS; l++) {
        const cn_layer *layer = &field->layer[l];
        const float bound = sqrtf(6.0f / (float)layer->in);
        for (size_t i = 0; i < (size_t)layer->out * layer->in; i++)
            weights[layer->offset + i] = (2 * cn_rng_float(seed, 2, layer->offset + i) - 1) * bound;
    }
}

void cn_field_transpose(const cn_field *field, const float *weights, float *transposed)
{
    for (int l = 0; l < CN_LAYERS; l++) {
        const cn_layer *layer = &field->layer[l];
        for (uint32_t o = 0; o < layer->out; o++)
            for (uint32_t i = 0; i < layer->in; i++)
                transposed[layer->offset + (size_t)i * layer->out + o] =
                    weights[layer->offset + (size_t)o * layer->in + i];
    }
}

/* Floats between two buffers. A layer reads one panel and writes another; where both lie at the same place of a page, a
 * load waits for stores that it has nothing to do with: a quarter of the time of a 64 x 64 layer. */
enum { STAGGER = 272 };

void cn_field_acts_take(const cn_field *field, cn_arena *arena, size_t n_panels, cn_field_acts *acts)
{
    float **const buffer[] = { &acts->enc, &acts->hidden, &acts->in, &acts->c0, &acts->c1, &acts->out };
    const uint32_t rows[] = { field->enc_rows,
                              field->config.density_width,
                              field->colour_in,
                              field->config.colour_width,
                              field->config.colour_width,
                              4 };
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        *buffer[i] = CN_ARENA_NEW(arena, float, n_panels *CN_PANEL *rows[i] + STAGGER);
}

void cn_field_encode_level(const cn_field *field, const cn_kernel *k, const uint32_t *table, uint32_t level,
                           const float *pos, size_t n_panels, float *enc)
{
    k->encode(&field->level[level], table + field->level[level].offset, pos, n_panels,
              enc + (size_t)level * 2 * CN_PANEL, (size_t)field->enc_rows * CN_PANEL);
}

/* y = W x of one panel. */
static void forward(const cn_field *field, const cn_kernel *k, const float *transposed, int layer, const float *x,
                    float *y, bool relu)
{
    const cn_layer *l = &field->layer[layer];
    k->gemm(transposed + l->offset, l->out, l->in, x, y, NULL, relu);
}

/* dx = W^T dy of one panel, zero where gate (the activation behind dx) is not positive. */
static void backward(const cn_field *field, const cn_kernel *k, const float *weights, int layer, const float *dy,
                     float *dx, const float *gate)
{
    const cn_layer *l = &field->layer[layer];
    k->gemm(weights + l->offset, l->in, l->out, dy, dx, gate, false);
}

void cn_field_logits(const cn_field *field, const cn_kernel *k, const cn_field_params *params, const float *enc,
                     size_t n_panels, float *hidden, float *geo, float *logit)
{
    for (size_t p = 0; p < n_panels; p++) {
        forward(field, k, params->transposed, CN_LAYER_DENSITY0, enc + p * field->enc_rows * CN_PANEL, hidden, true);
        forward(field, k, params->transposed, CN_LAYER_DENSITY1, hidden, geo, false);
        memcpy(logit + p * CN_PANEL, geo, CN_PANEL * sizeof(float));
    }
}

void cn_field_geometry(const cn_field *field, const cn_kernel *k, const cn_field_params *params, const float *enc,
                       size_t n_panels, float *hidden, float *geo)
{
    for (size_t p = 0; p < n_panels; p++) {
        forward(field, k, params->transposed, CN_LAYER_DENSITY0, enc + p * field->enc_rows * CN_PANEL, hidden, true);
        forward(field, k, params->transposed, CN_LAYER_DENSITY1, hidden, geo + p * CN_GEO * CN_PANEL, false);
    }
}

void cn_field_density(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                      const cn_field_acts *acts, size_t n_panels)
{
    const size_t dw = field->config.density_width;
    for (size_t p = 0; p < n_panels; p++) {
        float *hidden = acts->hidden + p * dw * CN_PANEL;
        forward(field, k, params->transposed, CN_LAYER_DENSITY0, acts->enc + p * field->enc_rows * CN_PANEL, hidden,
                true);
        forward(field, k, params->transposed, CN_LAYER_DENSITY1, hidden, acts->in + p * field->colour_in * CN_PANEL,
                false);
    }
}

void cn_field_colour(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, size_t n_panels)
{
    const size_t cw = field->config.colour_width;
    for (size_t p = 0; p < n_panels; p++) {
        float *c0 = acts->c0 + p * cw * CN_PANEL, *c1 = acts->c1 + p * cw * CN_PANEL;
        forward(field, k, params->transposed, CN_LAYER_COLOUR0, acts->in + p * field->colour_in * CN_PANEL, c0, true);
        forward(field, k, params->transposed, CN_LAYER_COLOUR1, c0, c1, true);
        forward(field, k, params->transposed, CN_LAYER_COLOUR2, c1, acts->out + p * 4 * CN_PANEL, false);
    }
}

static void weight_grad(const cn_field *field, const cn_kernel *k, int layer, const float *dy, size_t dy_rows,
                        const float *x, size_t n_panels, float *dw)
{
    const cn_layer *l = &field->layer[layer];
    k->weight_grad(dy, dy_rows * CN_PANEL, x, (size_t)l->in * CN_PANEL, l->out, l->in, n_panels, dw + l->offset);
}

/* Panels are taken a few at a time, so that what one layer writes is still in cache when the weight gradients read it.
 */
enum { CHUNK = 4 };

void cn_field_backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                       const cn_field_acts *acts, const cn_field_acts *d, const float *d_logit, size_t n_panels,
                       float *dw)
{
    const size_t width = field->config.colour_width * (size_t)CN_PANEL, in = field->colour_in * (size_t)CN_PANEL;
    const size_t hidden = field->config.density_width * (size_t)CN_PANEL, enc = field->enc_rows * (size_t)CN_PANEL;
    for (size_t first = 0; first < n_panels; first += CHUNK) {
        const size_t n = n_panels - first < CHUNK ? n_panels - first : CHUNK;
        for (size_t p = first; p < first + n; p++) {
            backward(field, k, params->weights, CN_LAYER_COLOUR2, d->out + p * 4 * CN_PANEL, d->c1 + p * width,
                     acts->c1 + p * width);
            backward(field, k, params->weights, CN_LAYER_COLOUR1, d->c1 + p * width, d->c0 + p * width,
                     acts->c0 + p * width);
            backward(field, k, params->weights, CN_LAYER_COLOUR0, d->c0 + p * width, d->in + p * in, NULL);
            for (int lane = 0; lane < CN_PANEL; lane++)
                d->in[p * in + lane] += d_logit[p * CN_PANEL + lane];
            backward(field, k, params->weights, CN_LAYER_DENSITY1, d->in + p * in, d->hidden + p * hidden,
                     acts->hidden + p * hidden);
            backward(field, k, params->weights, CN_LAYER_DENSITY0, d->hidden + p * hidden, d->enc + p * enc, NULL);
        }
        weight_grad(field, k, CN_LAYER_COLOUR2, d->out + first * 4 * CN_PANEL, 4, acts->c1 + first * width, n, dw);
        weight_grad(field, k, CN_LAYER_COLOUR1, d->c1 + first * width, field->config.colour_width,
                    acts->c0 + first * width, n, dw);
        weight_grad(field, k, CN_LAYER_COLOUR0, d->c0 + first * width, field->config.colour_width,
                    acts->in + first * in, n, dw);
        weight_grad(field, k, CN_LAYER_DENSITY1, d->in + first * in, field->colour_in, acts->hidden + first * hidden, n,
                    dw);
        weight_grad(field, k, CN_LAYER_DENSITY0, d->hidden + first * hidden, field->config.density_width,
                    acts->enc + first * enc, n, dw);
    }
}

void cn_field_colour_backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                              const cn_field_acts *acts, const cn_field_acts *d, size_t n_panels)
{
    const size_t width = field->config.colour_width * (size_t)CN_PANEL, in = field->colour_in * (size_t)CN_PANEL;
    for (size_t p = 0; p < n_panels; p++) {
        backward(field, k, params->weights, CN_LAYER_COLOUR2, d->out + p * 4 * CN_PANEL, d->c1 + p * width,
                 acts->c1 + p * width);
        backward(field, k, params->weights, CN_LAYER_COLOUR1, d->c1 + p * width, d->c0 + p * width,
                 acts->c0 + p * width);
        backward(field, k, params->weights, CN_LAYER_COLOUR0, d->c0 + p * width, d->in + p * in, NULL);
    }
}
