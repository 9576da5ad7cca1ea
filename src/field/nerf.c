/* NeRF (Mildenhall et al. 2020): a frequency encoding of position and direction, and a deep network. The number of
 * hidden layers is an option; one layer reads the encoding again. Only the colour network reads the direction. The
 * paper's coarse network finds where matter is; here the occupancy grid does. The photos' appearance codes are inputs
 * beside the direction. */
#include "base/rng.h"
#include "base/units.h"
#include "field/field.h"

#include <string.h>

/* Indices of the kept activations in cn_field_acts.own. */
enum { HIDDEN, COLOUR_IN, COLOUR_HIDDEN };
enum { FIRST_HARMONIC = 1 };     /* the harmonics of degree 1 are the direction ... */
#define OF_DIRECTION 2.04665342f /* ... times this, up to order and sign */

static const cn_field_option options[] = {
    { "frequencies", "of place, each twice the one before", 1, 14, { 9, 11, 11, 11, 11 }, true },
    { "direction_frequencies", "of direction", 0, 6, { 4, 4, 4, 4, 4 }, true },
    { "depth", "hidden layers of the density network", 1, CN_STACK_DEPTH, { 4, 6, 8, 8, 6 }, true },
    { "width", "units of each of them", 8, 256, { 64, 128, 256, 256, 96 }, true },
    { "skip", "layer that reads the encoding again; 0: none", 0, CN_STACK_DEPTH, { 3, 4, 5, 5, 4 }, true },
    { "colour_units", "of the colour network's hidden layer", 8, 256, { 32, 64, 128, 128, 64 }, true },
};

static cn_layer add_layer(cn_field *field, const char *name, uint32_t out, uint32_t in)
{
    const cn_layer layer = { out, in, field->n_weights };
    field->n_weights += (size_t)out * in;
    cn_field_add_block(field, name, CN_FIELD_WEIGHTS, out, in, layer.offset);
    return layer;
}

/* Index of the hidden layer that reads the encoding again; past the last layer: none. */
static bool reads_again(const cn_stack *s, uint32_t layer)
{
    return layer > 0 && layer + 1 == s->skip;
}

static cn_status layout(cn_field *field)
{
    static const char *const names[CN_STACK_DEPTH] = { "nerf.0", "nerf.1", "nerf.2", "nerf.3",
                                                       "nerf.4", "nerf.5", "nerf.6", "nerf.7" };
    cn_stack *s = &field->stack;
    s->depth = (uint32_t)cn_field_option_of(field, "depth");
    s->width = (uint32_t)cn_field_option_of(field, "width");
    s->skip = (uint32_t)cn_field_option_of(field, "skip");
    s->frequencies = (uint32_t)cn_field_option_of(field, "frequencies");
    const uint32_t colour = (uint32_t)cn_field_option_of(field, "colour_units");
    if (s->width % 4) return cn_fail(CN_ERR_CONFIG, "field.width is %u; give a multiple of 4 from 8 to 256", s->width);
    if (colour % 4)
        return cn_fail(CN_ERR_CONFIG, "field.colour_units is %u; give a multiple of 4 from 8 to 256", colour);
    const uint32_t seen = (uint32_t)cn_field_option_of(field, "direction_frequencies");
    s->direction_rows = field->inputs.harmonics ? (6 * seen + 3) & ~3u : 0;
    field->enc_rows = (3 + 6 * s->frequencies + 1 + 3) & ~3u;
    field->geo_rows = s->width;
    field->conditioning = (field->inputs.n + 3u) & ~3u;
    field->colour_in = field->geo_rows + field->conditioning;
    field->n_encoders = 1;
    for (uint32_t l = 0; l < s->depth; l++) {
        const uint32_t in = l ? s->width + (reads_again(s, l) ? field->enc_rows : 0) : field->enc_rows;
        s->row[l] = s->rows;
        s->rows += s->width + (l + 1 < s->depth && reads_again(s, l + 1) ? field->enc_rows : 0);
        s->hidden[l] = add_layer(field, names[l], s->width, in);
    }
    s->head = add_layer(field, "nerf.head", field->geo_rows, s->width);
    s->colour[0] = add_layer(field, "nerf.colour.0", colour, field->colour_in + s->direction_rows);
    s->colour[1] = add_layer(field, "nerf.colour.1", 4, colour);
    field->n_derived = field->n_weights;
    return CN_OK;
}

static uint32_t layers_of(const cn_stack *s, const cn_layer *list[CN_STACK_DEPTH + 3])
{
    uint32_t n = 0;
    for (uint32_t l = 0; l < s->depth; l++)
        list[n++] = &s->hidden[l];
    list[n++] = &s->head;
    list[n++] = &s->colour[0];
    list[n++] = &s->colour[1];
    return n;
}

static void init(const cn_field *field, uint64_t seed, float *table, float *weights)
{
    (void)table;
    const cn_layer *list[CN_STACK_DEPTH + 3];
    const uint32_t n = layers_of(&field->stack, list);
    for (uint32_t l = 0; l < n; l++) {
        const float bound = sqrtf(6.0f / (float)list[l]->in);
        for (size_t i = 0; i < (size_t)list[l]->out * list[l]->in; i++)
            weights[list[l]->offset + i] = (2 * cn_rng_float(seed, 2, list[l]->offset + i) - 1) * bound;
    }
}

static void prepare(const cn_field *field, const float *weights, float *derived)
{
    const cn_layer *list[CN_STACK_DEPTH + 3];
    const uint32_t n = layers_of(&field->stack, list);
    for (uint32_t l = 0; l < n; l++)
        for (uint32_t o = 0; o < list[l]->out; o++)
            for (uint32_t i = 0; i < list[l]->in; i++)
                derived[list[l]->offset + (size_t)i * list[l]->out + o] =
                    weights[list[l]->offset + (size_t)o * list[l]->in + i];
}

static void acts_take(const cn_field *field, cn_arena *arena, size_t n_panels, cn_field_acts *acts)
{
    const cn_stack *s = &field->stack;
    const size_t lanes = n_panels * CN_PANEL;
    acts->enc = CN_ARENA_NEW(arena, float, lanes * field->enc_rows);
    acts->in = CN_ARENA_NEW(arena, float, lanes * field->colour_in);
    acts->out = CN_ARENA_NEW(arena, float, lanes * 4);
    acts->own[HIDDEN] = CN_ARENA_NEW(arena, float, lanes * s->rows);
    acts->own[COLOUR_IN] = CN_ARENA_NEW(arena, float, lanes * s->colour[0].in);
    acts->own[COLOUR_HIDDEN] = CN_ARENA_NEW(arena, float, lanes * s->colour[0].out);
}

/* ---- frequencies ---- */

/* sin and cos of x 2^k pi for k = 0 ..: rows sin, cos for each k, `stride` floats apart. Uses the double-angle
 * formulas; the error doubles too, to 1e-4 at the tenth k. */
static void oscillate(float x, uint32_t n, float *rows, size_t stride)
{
    float s = sinf((float)CN_PI * x), c = cosf((float)CN_PI * x);
    for (uint32_t k = 0; k < n; k++) {
        rows[(size_t)2 * k * stride] = s;
        rows[((size_t)2 * k + 1) * stride] = c;
        const float doubled = 2 * s * c;
        c = 1 - 2 * s * s;
        s = doubled;
    }
}

/* The gradient of x from the gradients of its rows. */
static float oscillate_backward(const float *rows, const float *d_rows, uint32_t n, size_t stride)
{
    float d = 0, scale = (float)CN_PI;
    for (uint32_t k = 0; k < n; k++, scale *= 2)
        d += scale * (d_rows[(size_t)2 * k * stride] * rows[((size_t)2 * k + 1) * stride] -
                      d_rows[((size_t)2 * k + 1) * stride] * rows[(size_t)2 * k * stride]);
    return d;
}

/* The tile's box is -1 .. 1, and what is outside it reaches to -2 and 2. The lowest frequency has one period over all
 * of this, because places that are a period apart would have the same rows. */
#define OF_POSITION 0.5f

/* Rows: the position, the frequencies axis by axis, and ones. */
static void encode(const cn_field *field, const cn_kernel *k, uint32_t encoder, const cn_field_encoding *of)
{
    (void)k, (void)encoder;
    const uint32_t n = field->stack.frequencies;
    for (size_t p = 0; p < of->n_panels; p++)
        for (size_t lane = 0; lane < CN_PANEL; lane++) {
            float *out = of->enc + p * field->enc_rows * CN_PANEL + lane;
            for (size_t a = 0; a < 3; a++) {
                const float x = 4 * of->pos[(p * 3 + a) * CN_PANEL + lane] - 2;
                out[a * CN_PANEL] = x;
                oscillate(OF_POSITION * x, n, out + (3 + a * 2 * n) * CN_PANEL, CN_PANEL);
            }
            for (size_t r = 3 + 6 * (size_t)n; r < field->enc_rows; r++)
                out[r * CN_PANEL] = 1;
        }
}

static void encode_backward(const cn_field *field, const cn_kernel *k, const uint32_t *table, uint32_t section,
                            const cn_encode_gradient *in)
{
    (void)field, (void)table, (void)k, (void)section, (void)in; /* there is no table */
}

static void position_gradient(const cn_field *field, const uint32_t *table, const float *pos, const float *d_enc,
                              uint32_t n, float (*d_pos)[3])
{
    (void)table;
    const uint32_t frequencies = field->stack.frequencies;
    for (uint32_t i = 0; i < n; i++) {
        const size_t panel = i / CN_PANEL, lane = i % CN_PANEL;
        const float *d = d_enc + panel * field->enc_rows * CN_PANEL + lane;
        for (size_t a = 0; a < 3; a++) {
            float rows[2 * 14], d_rows[2 * 14];
            oscillate(OF_POSITION * (4 * pos[(panel * 3 + a) * CN_PANEL + lane] - 2), frequencies, rows, 1);
            for (size_t r = 0; r < 2 * (size_t)frequencies; r++)
                d_rows[r] = d[(3 + a * 2 * frequencies + r) * CN_PANEL];
            d_pos[i][a] = 4 * (d[a * CN_PANEL] + OF_POSITION * oscillate_backward(rows, d_rows, frequencies, 1));
        }
    }
}

/* ---- forward ---- */

static void forward(const cn_kernel *k, const cn_field_params *params, const cn_layer *l, const float *x, float *y,
                    bool relu)
{
    k->gemm((cn_matrix){ params->derived + l->offset, l->out, l->in }, x, y, NULL, relu);
}

/* One panel: hidden layers and geometry. The encoding is appended to the input of the layer that reads it again. */
static void density_panel(const cn_field *field, const cn_kernel *k, const cn_field_params *params, const float *enc,
                          float *hidden, float *geo)
{
    const cn_stack *s = &field->stack;
    for (uint32_t l = 0; l < s->depth; l++) {
        const float *x = l ? hidden + (size_t)s->row[l - 1] * CN_PANEL : enc;
        float *y = hidden + (size_t)s->row[l] * CN_PANEL;
        forward(k, params, &s->hidden[l], x, y, true);
        if (l + 1 < s->depth && reads_again(s, l + 1))
            memcpy(y + (size_t)s->width * CN_PANEL, enc, (size_t)field->enc_rows * CN_PANEL * sizeof *enc);
    }
    forward(k, params, &s->head, hidden + (size_t)s->row[s->depth - 1] * CN_PANEL, geo, false);
}

static void geometry(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, size_t n_panels, float *geo)
{
    for (size_t p = 0; p < n_panels; p++)
        density_panel(field, k, params, acts->enc + p * field->enc_rows * CN_PANEL, acts->own[HIDDEN],
                      geo + p * field->geo_rows * CN_PANEL);
}

static void logits(const cn_field *field, const cn_kernel *k, const cn_field_params *params, const cn_field_acts *acts,
                   size_t n_panels, float *logit)
{
    for (size_t p = 0; p < n_panels; p++) {
        density_panel(field, k, params, acts->enc + p * field->enc_rows * CN_PANEL, acts->own[HIDDEN], acts->in);
        memcpy(logit + p * CN_PANEL, acts->in, CN_PANEL * sizeof *logit);
    }
}

static void density_pass(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                         const cn_field_acts *acts, size_t n_panels)
{
    for (size_t p = 0; p < n_panels; p++)
        density_panel(field, k, params, acts->enc + p * field->enc_rows * CN_PANEL,
                      acts->own[HIDDEN] + p * field->stack.rows * CN_PANEL, acts->in + p * field->colour_in * CN_PANEL);
}

static void colour_pass(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                        const cn_field_acts *acts, size_t n_panels)
{
    const cn_stack *s = &field->stack;
    const size_t in = (size_t)field->colour_in * CN_PANEL;
    const uint32_t n = (uint32_t)cn_field_option_of(field, "direction_frequencies");
    for (size_t p = 0; p < n_panels; p++) {
        float *x = acts->own[COLOUR_IN] + p * s->colour[0].in * CN_PANEL, *seen = x + in,
              *hidden = acts->own[COLOUR_HIDDEN] + p * s->colour[0].out * CN_PANEL;
        const float *direction = acts->in + p * in + (size_t)(field->geo_rows + FIRST_HARMONIC) * CN_PANEL;
        memcpy(x, acts->in + p * in, in * sizeof *x);
        memset(seen, 0, (size_t)s->direction_rows * CN_PANEL * sizeof *seen);
        for (size_t i = 0; s->direction_rows && i < (size_t)3 * CN_PANEL; i++)
            oscillate(OF_DIRECTION * direction[i], n, seen + i / CN_PANEL * 2 * n * CN_PANEL + i % CN_PANEL, CN_PANEL);
        forward(k, params, &s->colour[0], x, hidden, true);
        forward(k, params, &s->colour[1], hidden, acts->out + p * 4 * CN_PANEL, false);
    }
}

/* ---- backward ---- */

static void backward_layer(const cn_kernel *k, const cn_field_params *params, const cn_layer *l, const float *dy,
                           float *dx, const float *gate)
{
    k->gemm((cn_matrix){ params->weights + l->offset, l->in, l->out }, dy, dx, gate, false);
}

static void colour_backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                            const cn_field_acts *acts, const cn_field_acts *d, size_t n_panels)
{
    const cn_stack *s = &field->stack;
    const size_t in = (size_t)field->colour_in * CN_PANEL, wide = (size_t)s->colour[0].in * CN_PANEL,
                 hidden = (size_t)s->colour[0].out * CN_PANEL;
    const uint32_t n = (uint32_t)cn_field_option_of(field, "direction_frequencies");
    for (size_t p = 0; p < n_panels; p++) {
        const float *seen = acts->own[COLOUR_IN] + p * wide + in, *d_seen = d->own[COLOUR_IN] + p * wide + in;
        float *d_in = d->in + p * in, *d_direction = d_in + (size_t)(field->geo_rows + FIRST_HARMONIC) * CN_PANEL;
        backward_layer(k, params, &s->colour[1], d->out + p * 4 * CN_PANEL, d->own[COLOUR_HIDDEN] + p * hidden,
                       acts->own[COLOUR_HIDDEN] + p * hidden);
        backward_layer(k, params, &s->colour[0], d->own[COLOUR_HIDDEN] + p * hidden, d->own[COLOUR_IN] + p * wide,
                       NULL);
        memcpy(d_in, d->own[COLOUR_IN] + p * wide, in * sizeof *d_in);
        for (size_t i = 0; s->direction_rows && i < (size_t)3 * CN_PANEL; i++) {
            const size_t at = i / CN_PANEL * 2 * n * CN_PANEL + i % CN_PANEL;
            d_direction[i] += OF_DIRECTION * oscillate_backward(seen + at, d_seen + at, n, CN_PANEL);
        }
    }
}

/* From d->in to d->enc, through all hidden layers of a panel. */
static void density_backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                             const cn_field_acts *acts, const cn_field_acts *d, size_t p)
{
    const cn_stack *s = &field->stack;
    const size_t enc = (size_t)field->enc_rows * CN_PANEL, width = (size_t)s->width * CN_PANEL;
    const float *h = acts->own[HIDDEN] + p * s->rows * CN_PANEL;
    float *d_h = d->own[HIDDEN] + p * s->rows * CN_PANEL, *d_enc = d->enc + p * enc;
    const size_t last = (size_t)s->row[s->depth - 1] * CN_PANEL;
    const float *again = NULL;
    backward_layer(k, params, &s->head, d->in + p * field->colour_in * CN_PANEL, d_h + last, h + last);
    for (uint32_t l = s->depth; l-- > 1;) {
        const size_t at = (size_t)s->row[l - 1] * CN_PANEL, from = (size_t)s->row[l] * CN_PANEL;
        const bool skips = reads_again(s, l); /* then the gate covers only the hidden rows */
        backward_layer(k, params, &s->hidden[l], d_h + from, d_h + at, skips ? NULL : h + at);
        if (!skips) continue;
        for (size_t i = 0; i < width; i++)
            if (!(h[at + i] > 0)) d_h[at + i] = 0;
        again = d_h + at + width;
    }
    backward_layer(k, params, &s->hidden[0], d_h, d_enc, NULL);
    for (size_t i = 0; again && i < enc; i++)
        d_enc[i] += again[i];
}

static void weight_grads(const cn_field *field, const cn_kernel *k, const cn_field_acts *acts, const cn_field_acts *d,
                         size_t n, float *dw)
{
    const cn_stack *s = &field->stack;
    const size_t rows = (size_t)s->rows * CN_PANEL, wide = (size_t)s->colour[0].in * CN_PANEL,
                 hidden = (size_t)s->colour[0].out * CN_PANEL;
    for (uint32_t l = 0; l < s->depth; l++) {
        const cn_layer *y = &s->hidden[l];
        const float *x = l ? acts->own[HIDDEN] + (size_t)s->row[l - 1] * CN_PANEL : acts->enc;
        k->weight_grad(&(cn_panel_rows){ d->own[HIDDEN] + (size_t)s->row[l] * CN_PANEL, rows, y->out },
                       &(cn_panel_rows){ x, l ? rows : (size_t)field->enc_rows * CN_PANEL, y->in }, n, dw + y->offset);
    }
    k->weight_grad(&(cn_panel_rows){ d->in, (size_t)field->colour_in * CN_PANEL, s->head.out },
                   &(cn_panel_rows){ acts->own[HIDDEN] + (size_t)s->row[s->depth - 1] * CN_PANEL, rows, s->head.in }, n,
                   dw + s->head.offset);
    k->weight_grad(&(cn_panel_rows){ d->own[COLOUR_HIDDEN], hidden, s->colour[0].out },
                   &(cn_panel_rows){ acts->own[COLOUR_IN], wide, s->colour[0].in }, n, dw + s->colour[0].offset);
    k->weight_grad(&(cn_panel_rows){ d->out, (size_t)4 * CN_PANEL, 4 },
                   &(cn_panel_rows){ acts->own[COLOUR_HIDDEN], hidden, s->colour[1].in }, n, dw + s->colour[1].offset);
}

static void backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, const cn_field_gradient *d, size_t n_panels)
{
    colour_backward(field, k, params, acts, d->acts, n_panels);
    for (size_t p = 0; p < n_panels; p++) {
        for (size_t lane = 0; lane < CN_PANEL; lane++)
            d->acts->in[p * field->colour_in * CN_PANEL + lane] += d->logit[p * CN_PANEL + lane];
        density_backward(field, k, params, acts, d->acts, p);
    }
    weight_grads(field, k, acts, d->acts, n_panels, d->weights);
}

const cn_field_type cn_field_type_nerf = {
    .name = "nerf",
    .summary = "frequency encoding and a deep network (Mildenhall et al. 2020)",
    .options = options,
    .n_options = sizeof options / sizeof *options,
    .density = CN_DENSITY_EXP,
    .weight_rate = 0.1,
    .layout = layout,
    .init = init,
    .prepare = prepare,
    .acts_take = acts_take,
    .encode = encode,
    .encode_backward = encode_backward,
    .position_gradient = position_gradient,
    .logits = logits,
    .geometry = geometry,
    .density_pass = density_pass,
    .colour_pass = colour_pass,
    .colour_backward = colour_backward,
    .backward = backward,
};
