/* A signed distance on the hash grid, with the density of VolSDF (Yariv et al. 2021): 1 / beta times the Laplace
 * distribution function of -distance; beta is learned. Distances are in half extents of the tile, in contracted space,
 * so that one field holds the background too. It is initialised as a ball of free space around the tile's centre, seen
 * from inside. The passes return the logarithm of the density as logit; the colour network does not read it.
 *
 * The network's output, with the ball added, is the ratio of distance and beta. So its values have the size of a log
 * density, whatever beta is, and one learning rate suits it from the fog of the first steps to sharp surfaces. With the
 * distance itself as output, most hidden units die in the first steps.
 *
 * The eikonal loss asks for a gradient of length 1, at some of the samples with weight (`slope_losses`), of what the
 * coarser half of the levels makes of the distance. Finer levels only displace the surface, as in Neuralangelo (Li et
 * al. 2023), whose differences over a step average them out. A sample counts by its weight in the pixel: Adam makes
 * steps of one length from small gradients too, so otherwise the loss alone would shape what photos hardly see. The
 * loss's gradient needs the second derivatives of the distance by position and parameter. With ReLU units these are
 * products of first derivatives. What the table needs for them is stored with the features' gradients, in rows of the
 * encoding that are 0 in the forward pass. */
#include "base/rng.h"
#include "field/cell.h"
#include "field/grid_mlp.h"

#include <string.h>

enum { OWN_RATIO = 3 }; /* in cn_field_acts.own: two rows a panel, ratio and logit */
enum {
    SLOPE_EVERY = 4,
    BETA_FLOATS = 8
}; /* every n-th sample; floats of beta's block, of which only the first is used */
enum { MOST_ROWS = 3 * CN_MAX_LEVELS + 12, MOST_UNITS = 256 };
#define BOX 4.0f /* a position's range 0 to 1 in units of distance */
/* Thin fog at first, of the density that 0.4 has with a ratio of 0.9 at the centre. From 0.4 downwards beta takes a
 * third of preview, and the eikonal loss forbids steep densities for so long: see EIKONAL. */
#define FIRST_BETA 0.05f
#define FIRST_RATIO 2.95f /* at the tile's centre */
#define FIRST_SLOPE 1.25f /* of the ratio, outwards and down */

/* Relative to the loss of colours. Tuned at preview. Held-out PSNR of fox, castle where hash has 27.9, 26.0 dB: 1e-4
 * 27.8, 25.7; 5e-4 -, 25.4. Less good ways, on the same sets: samples count alike however little the photos see of them
 * 27.6, 22.4; so, and the slope of all levels 26.8, -; no loss, with a first beta of 0.4 27.5, 25.3. */
#define EIKONAL 1e-4

static const cn_field_option options[] = {
    { "levels", "of the hash grid", 1, CN_MAX_LEVELS, { 16, 16, 16, 16, 10 }, true },
    { "log2_table", "entries of a level, as a power of two", 8, 24, { 17, 19, 19, 21, 14 }, true },
    { "base_resolution", "cells across the tile at the coarsest level", 2, 65536, { 16, 16, 16, 16, 16 }, true },
    { "finest_resolution",
      "cells across the tile at the finest level",
      2,
      1048576,
      { 1024, 2048, 2048, 4096, 1024 },
      true },
    { "density_width", "units of the distance network's hidden layer", 4, 256, { 64, 64, 64, 64, 64 }, true },
    { "colour_width", "units of the colour network's two hidden layers", 4, 256, { 64, 64, 64, 64, 64 }, true },
    { "eikonal",
      "weight of the loss that asks a slope of 1 of the distance",
      0,
      1,
      { EIKONAL, EIKONAL, EIKONAL, EIKONAL, EIKONAL },
      false },
    { "least_beta",
      "width of a surface at the least, in half extents",
      1e-5,
      0.1,
      { 1e-3, 5e-4, 5e-4, 2e-4, 5e-4 },
      false },
};

/* The levels whose slope the eikonal loss reads. */
static uint32_t coarse_levels(const cn_field *field)
{
    return (field->grid.n_levels + 1) / 2;
}

/* Rows of the encoding: features, position and whether there is one; then what the table needs for the eikonal loss. */
static size_t place_row(const cn_field *field)
{
    return field->mlp.layer[CN_LAYER_DENSITY0].in;
}
static size_t slope_row(const cn_field *field)
{
    return place_row(field) + 4;
}
static size_t direction_row(const cn_field *field)
{
    return slope_row(field) + (size_t)2 * coarse_levels(field);
}

static cn_status layout(cn_field *field)
{
    const double log2_table = cn_field_option_of(field, "log2_table");
    if (!(log2_table >= 8 && log2_table <= 24))
        return cn_fail(CN_ERR_CONFIG, "field.log2_table is %g; give 8 to 24", log2_table);
    CN_TRY(cn_grid_mlp_layout(field, 1u << (uint32_t)log2_table, "sdf.table"));
    field->enc_rows = field->mlp.enc_rows = (uint32_t)(direction_row(field) + 3 + 3) & ~3u;
    field->n_weights += BETA_FLOATS;
    cn_field_add_block(field, "sdf.beta", CN_FIELD_WEIGHTS, BETA_FLOATS, 1, field->mlp.n_weights);
    return CN_OK;
}

static void init(const cn_field *field, uint64_t seed, float *table, float *weights)
{
    const cn_layer *colour = &field->mlp.layer[CN_LAYER_COLOUR0];
    cn_grid_mlp_init(field, seed, table, weights);
    for (uint32_t o = 0; o < colour->out; o++) /* the logit's column: see colour_pass */
        weights[colour->offset + (size_t)o * colour->in] = 0;
    for (size_t i = 0; i < BETA_FLOATS; i++)
        weights[field->mlp.n_weights + i] = logf(FIRST_BETA);
}

/* What the network's output is added to: falls from the centre outwards. x: position in units of distance. Its gradient
 * by x is -FIRST_SLOPE * x / length. */
static float ball(const float x[3], float *length)
{
    *length = sqrtf(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
    return FIRST_RATIO - FIRST_SLOPE * *length;
}

static void prepare(const cn_field *field, const float *weights, float *derived)
{
    cn_mlp_transpose(&field->mlp, weights, derived);
}

static void acts_take(const cn_field *field, cn_arena *arena, size_t n_panels, cn_field_acts *acts)
{
    cn_mlp_acts_take(&field->mlp, arena, n_panels, acts);
    acts->own[OWN_RATIO] = CN_ARENA_NEW(arena, float, n_panels *CN_PANEL * 2);
}

/* The first encoder also writes the rows that are not features. */
static void encode(const cn_field *field, const cn_kernel *k, uint32_t encoder, const cn_field_encoding *of)
{
    cn_grid_mlp_encode(field, k, encoder, of);
    for (size_t p = 0; !encoder && p < of->n_panels; p++) {
        float *enc = of->enc + p * field->enc_rows * CN_PANEL, *row = enc + place_row(field) * CN_PANEL;
        memset(enc + (size_t)2 * field->grid.n_levels * CN_PANEL, 0,
               (place_row(field) - (size_t)2 * field->grid.n_levels) * CN_PANEL * sizeof *row);
        for (size_t i = 0; i < (size_t)3 * CN_PANEL; i++)
            row[i] = BOX * of->pos[p * 3 * CN_PANEL + i] - BOX / 2;
        for (size_t i = (size_t)3 * CN_PANEL; i < (size_t)4 * CN_PANEL; i++)
            row[i] = 1;
        memset(row + (size_t)4 * CN_PANEL, 0, (field->enc_rows - slope_row(field)) * CN_PANEL * sizeof *row);
    }
}

static void encode_backward(const cn_field *field, const cn_kernel *k, const uint32_t *table, uint32_t section,
                            const cn_encode_gradient *in)
{
    cn_grid_mlp_encode_backward(field, k, table, section, in);
    for (size_t i = 0; i < in->n_panels * CN_PANEL; i += SLOPE_EVERY) {
        const float *d = in->d_enc + i / CN_PANEL * in->stride + i % CN_PANEL,
                    *p = in->pos + i / CN_PANEL * 3 * CN_PANEL + i % CN_PANEL;
        if (section >= coarse_levels(field)) return;
        const float *u = d + direction_row(field) * CN_PANEL, *slope = d + (slope_row(field) + 2 * section) * CN_PANEL;
        if (u[0] == 0 && u[CN_PANEL] == 0 && u[2 * CN_PANEL] == 0) continue;
        const float x[3] = { p[0], p[CN_PANEL], p[2 * CN_PANEL] };
        cn_cell cell;
        cn_cell_find(&field->grid.level[section], x, &cell);
        for (int c = 0; c < 8; c++) {
            const uint32_t at = cell.entry[c] - in->range->first; /* wraps below the range */
            if (at >= in->range->count) continue;
            const float along =
                cell.slope[c][0] * u[0] + cell.slope[c][1] * u[CN_PANEL] + cell.slope[c][2] * u[2 * CN_PANEL];
            in->grad[2 * (size_t)at] += along * slope[0];
            in->grad[2 * (size_t)at + 1] += along * slope[CN_PANEL];
            if (in->touched) in->touched[at / CN_TOUCH] = 1;
        }
    }
}

static void position_gradient(const cn_field *field, const uint32_t *table, const float *pos, const float *d_enc,
                              uint32_t n, float (*d_pos)[3])
{
    cn_grid_mlp_position_gradient(field, table, pos, d_enc, n, d_pos);
    for (uint32_t i = 0; i < n; i++)
        for (size_t a = 0; a < 3; a++)
            d_pos[i][a] +=
                BOX * d_enc[((i / CN_PANEL) * field->enc_rows + place_row(field) + a) * CN_PANEL + i % CN_PANEL];
}

/* ---- density ---- */

static float growth_of(const cn_field *field, const float *weights)
{
    return expf(weights[field->mlp.n_weights]);
}

static float beta_of(const cn_field *field, const float *weights)
{
    return (float)cn_field_option_of(field, "least_beta") + growth_of(field, weights);
}

/* The log density of n_panels panels. value: row 0 of a panel, `stride` floats from one to the next; the network's
 * output, which the log density replaces. ratio: NULL, or the same of what receives the distance over beta. */
typedef struct panels {
    float *value;
    size_t stride;
    float *ratio;
    size_t ratio_stride;
} panels;
static void log_densities(const cn_field *field, const float *weights, const float *enc, size_t n_panels,
                          const panels *of)
{
    const float scale = logf(beta_of(field, weights));
    for (size_t p = 0; p < n_panels; p++) {
        const float *place = enc + (p * field->enc_rows + place_row(field)) * CN_PANEL;
        float *value = of->value + p * of->stride, q[CN_PANEL];
        for (size_t lane = 0; lane < CN_PANEL; lane++) {
            float length;
            const float x[3] = { place[lane], place[CN_PANEL + lane], place[2 * CN_PANEL + lane] };
            q[lane] = value[lane] + ball(x, &length);
            value[lane] = -0.6931472f - q[lane] - scale;
        }
        for (size_t lane = 0; lane < CN_PANEL; lane++)
            if (q[lane] < 0) value[lane] = logf(1 - 0.5f * expf(q[lane])) - scale;
        if (of->ratio) memcpy(of->ratio + p * of->ratio_stride, q, sizeof q);
    }
}

/* The distance from its log density. Deep inside, where the density does not change, it is some betas. */
static float distance_of(const cn_field *field, const float *weights, float logit)
{
    const float beta = beta_of(field, weights), clear = logit + logf(2 * beta);
    return clear < 0 ? -beta * clear : beta * logf(fmaxf(2 * (1 - beta * expf(logit)), 1e-6f));
}

static cn_mlp_params mlp_params(const cn_field_params *params)
{
    return (cn_mlp_params){ params->weights, params->derived };
}

static void logits(const cn_field *field, const cn_kernel *k, const cn_field_params *params, const cn_field_acts *acts,
                   size_t n_panels, float *logit)
{
    const cn_mlp_params of_mlp = mlp_params(params);
    cn_mlp_logits(&field->mlp, k, &of_mlp, acts, n_panels, logit);
    log_densities(field, params->weights, acts->enc, n_panels, &(panels){ logit, CN_PANEL, NULL, 0 });
}

static void geometry(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, size_t n_panels, float *geo)
{
    const cn_mlp_params of_mlp = mlp_params(params);
    cn_mlp_geometry(&field->mlp, k, &of_mlp, acts, n_panels, geo);
    log_densities(field, params->weights, acts->enc, n_panels, &(panels){ geo, (size_t)CN_GEO * CN_PANEL, NULL, 0 });
}

static void density_pass(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                         const cn_field_acts *acts, size_t n_panels)
{
    const cn_mlp_params of_mlp = mlp_params(params);
    cn_mlp_density(&field->mlp, k, &of_mlp, acts, n_panels);
    log_densities(field, params->weights, acts->enc, n_panels,
                  &(panels){ acts->in, (size_t)field->colour_in * CN_PANEL, acts->own[OWN_RATIO], 2 * CN_PANEL });
}

/* ---- colour. The logit is replaced by 0, because it is unbounded; so the first column never gets a gradient. ---- */

static void hide_logits(const cn_field *field, const cn_field_acts *acts, size_t n_panels)
{
    for (size_t p = 0; p < n_panels; p++) {
        float *logit = acts->in + p * field->colour_in * CN_PANEL;
        memcpy(acts->own[OWN_RATIO] + (p * 2 + 1) * CN_PANEL, logit, CN_PANEL * sizeof *logit);
        memset(logit, 0, CN_PANEL * sizeof *logit);
    }
}

static void show_logits(const cn_field *field, const cn_field_acts *acts, size_t n_panels)
{
    for (size_t p = 0; p < n_panels; p++)
        memcpy(acts->in + p * field->colour_in * CN_PANEL, acts->own[OWN_RATIO] + (p * 2 + 1) * CN_PANEL,
               CN_PANEL * sizeof(float));
}

static void colour_pass(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                        const cn_field_acts *acts, size_t n_panels)
{
    const cn_mlp_params of_mlp = mlp_params(params);
    hide_logits(field, acts, n_panels);
    cn_mlp_colour(&field->mlp, k, &of_mlp, acts, n_panels);
    show_logits(field, acts, n_panels);
}

/* ---- backward ---- */

/* What the eikonal loss needs of a panel: the gradient of the distance by the encoding, the directional derivative of
 * the encoding along the loss's gradient, and both for the hidden units. */
typedef struct slope_panel {
    _Alignas(64) float by_enc[MOST_ROWS * CN_PANEL];
    _Alignas(64) float change[MOST_ROWS * CN_PANEL];
    _Alignas(64) float by_hidden[MOST_UNITS * CN_PANEL];
    _Alignas(64) float hidden_change[MOST_UNITS * CN_PANEL];
    _Alignas(64) float one[CN_GEO * CN_PANEL]; /* the gradient of the network's output: 1 at the samples asked for */
} slope_panel;

/* What belongs to the eikonal loss of one sample, besides its panel's. */
typedef struct slope_sample {
    size_t lane;
    float beta, weight;
    double loss;  /* added to, like the next */
    float d_beta; /* of the loss by beta */
} slope_sample;

/* One sample: the loss of its distance gradient, the derivative of the loss by that gradient, and the features'
 * directional derivative along it. d_enc receives what the table needs. */
static void slope_loss(const cn_field *field, const uint32_t *table, const float *enc, slope_panel *s, float *d_enc,
                       slope_sample *of)
{
    const size_t lane = of->lane;
    const float *place = enc + place_row(field) * CN_PANEL + lane, *by = s->by_enc + lane;
    const float from_centre[3] = { place[0], place[CN_PANEL], place[2 * CN_PANEL] };
    cn_cell cells[CN_MAX_LEVELS];
    float x[3], g[3], u[3], radius;
    (void)ball(from_centre, &radius);
    for (size_t a = 0; a < 3; a++) {
        x[a] = from_centre[a] / BOX + 0.5f;
        g[a] = -FIRST_SLOPE * BOX * from_centre[a] / fmaxf(radius, 1e-6f);
    }
    for (uint32_t l = 0; l < coarse_levels(field); l++) {
        const cn_level *level = &field->grid.level[l];
        cn_cell_find(level, x, &cells[l]);
        for (int c = 0; c < 8; c++) {
            const uint32_t pair = table[level->offset + cells[l].entry[c]];
            const float value = by[(size_t)2 * l * CN_PANEL] * cn_bf16_to_float((uint16_t)pair) +
                                by[((size_t)2 * l + 1) * CN_PANEL] * cn_bf16_to_float((uint16_t)(pair >> 16));
            for (int a = 0; a < 3; a++)
                g[a] += value * cells[l].slope[c][a];
        }
    }
    const float steep = sqrtf(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]), length = steep * of->beta / BOX;
    for (size_t a = 0; a < 3; a++) {
        u[a] = of->weight * 2 * (length - 1) * of->beta / BOX * g[a] / fmaxf(steep, 1e-6f);
        d_enc[(direction_row(field) + a) * CN_PANEL + lane] = u[a];
    }
    for (uint32_t l = 0; l < coarse_levels(field); l++)
        for (int c = 0; c < 8; c++) {
            const uint32_t pair = table[field->grid.level[l].offset + cells[l].entry[c]];
            const float along = cells[l].slope[c][0] * u[0] + cells[l].slope[c][1] * u[1] + cells[l].slope[c][2] * u[2];
            s->change[(size_t)2 * l * CN_PANEL + lane] += along * cn_bf16_to_float((uint16_t)pair);
            s->change[((size_t)2 * l + 1) * CN_PANEL + lane] += along * cn_bf16_to_float((uint16_t)(pair >> 16));
        }
    for (size_t f = 0; f < (size_t)2 * coarse_levels(field); f++)
        d_enc[(slope_row(field) + f) * CN_PANEL + lane] = by[f * CN_PANEL];
    of->loss += (double)(of->weight * (length - 1) * (length - 1));
    of->d_beta += of->weight * 2 * (length - 1) * length / of->beta;
}

/* Where the gradients of the eikonal loss of a panel go. */
typedef struct slope_gradient {
    float *enc, *weights; /* weights NULL: none of the parameters */
} slope_gradient;

/* The eikonal loss of panel p. */
static double slope_losses(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                           const cn_field_acts *acts, size_t p, slope_gradient d)
{
    const cn_layer *first = &field->mlp.layer[CN_LAYER_DENSITY0], *second = &field->mlp.layer[CN_LAYER_DENSITY1];
    const float *enc = acts->enc + p * field->enc_rows * CN_PANEL,
                *hidden = acts->own[CN_MLP_HIDDEN] + p * first->out * CN_PANEL;
    slope_panel s;
    slope_sample of = { .beta = beta_of(field, params->weights) };
    const float weight = SLOPE_EVERY * params->prior * (float)cn_field_option_of(field, "eikonal");
    memset(s.change, 0, (size_t)first->in * CN_PANEL * sizeof *s.change);
    memset(s.one, 0, sizeof s.one);
    for (size_t lane = 0; lane < CN_PANEL; lane += SLOPE_EVERY)
        s.one[lane] = enc[(place_row(field) + 3) * CN_PANEL + lane]; /* 0 in lanes past the last sample */
    k->gemm((cn_matrix){ params->weights + second->offset, second->in, second->out }, s.one, s.by_hidden, hidden,
            false);
    k->gemm((cn_matrix){ params->weights + first->offset, first->in, first->out }, s.by_hidden, s.by_enc, NULL, false);
    for (size_t lane = 0; lane < CN_PANEL; lane += SLOPE_EVERY)
        if (s.one[lane] > 0) {
            of.lane = lane;
            of.weight = weight * (params->visible ? params->visible[p * CN_PANEL + lane] : 1);
            slope_loss(field, params->table, enc, &s, d.enc, &of);
        }
    if (!d.weights) return of.loss;
    k->gemm((cn_matrix){ params->derived + first->offset, first->out, first->in }, s.change, s.hidden_change, hidden,
            false);
    k->weight_grad(&(cn_panel_rows){ s.by_hidden, (size_t)first->out * CN_PANEL, first->out },
                   &(cn_panel_rows){ s.change, (size_t)first->in * CN_PANEL, first->in }, 1, d.weights + first->offset);
    k->weight_grad(&(cn_panel_rows){ s.one, (size_t)CN_GEO * CN_PANEL, second->out },
                   &(cn_panel_rows){ s.hidden_change, (size_t)second->in * CN_PANEL, second->in }, 1,
                   d.weights + second->offset);
    d.weights[field->mlp.n_weights] += of.d_beta * growth_of(field, params->weights);
    return of.loss;
}

static double prior_loss(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                         const cn_field_acts *acts, size_t n_panels)
{
    float d_enc[MOST_ROWS * CN_PANEL];
    double sum = 0;
    for (size_t p = 0; p < n_panels; p++)
        sum += slope_losses(field, k, params, acts, p, (slope_gradient){ d_enc, NULL });
    return sum;
}

static void colour_backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                            const cn_field_acts *acts, const cn_field_acts *d, size_t n_panels)
{
    const cn_mlp_params of_mlp = mlp_params(params);
    cn_mlp_colour_backward(&field->mlp, k, &of_mlp, acts, d, n_panels);
}

static void backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, const cn_field_gradient *d, size_t n_panels)
{
    const cn_mlp_params of_mlp = mlp_params(params);
    const float relative = growth_of(field, params->weights) / beta_of(field, params->weights);
    float *d_ratio = d->acts->own[OWN_RATIO], d_log_beta = 0;
    for (size_t i = 0; i < n_panels * CN_PANEL; i++) {
        const float q = acts->own[OWN_RATIO][i / CN_PANEL * 2 * CN_PANEL + i % CN_PANEL];
        const float e = 0.5f * expf(fminf(q, 0));
        d_ratio[i] = -d->logit[i] * e / (1 - e);
        d_log_beta -= d->logit[i];
    }
    d->weights[field->mlp.n_weights] += d_log_beta * relative;
    hide_logits(field, acts, n_panels);
    const cn_field_gradient of_ratio = { d->acts, d_ratio, d->weights };
    cn_mlp_backward(&field->mlp, k, &of_mlp, acts, &of_ratio, n_panels);
    show_logits(field, acts, n_panels);
    for (size_t p = 0; p < n_panels; p++) {
        float *d_enc = d->acts->enc + p * field->enc_rows * CN_PANEL, *d_place = d_enc + place_row(field) * CN_PANEL;
        const float *place = acts->enc + (p * field->enc_rows + place_row(field)) * CN_PANEL;
        for (size_t lane = 0; lane < CN_PANEL; lane++) {
            const float x[3] = { place[lane], place[CN_PANEL + lane], place[2 * CN_PANEL + lane] };
            float radius;
            (void)ball(x, &radius);
            for (size_t a = 0; a < 3; a++)
                d_place[a * CN_PANEL + lane] =
                    -FIRST_SLOPE * d_ratio[p * CN_PANEL + lane] * x[a] / fmaxf(radius, 1e-6f);
            d_place[3 * CN_PANEL + lane] = 0;
        }
        memset(d_enc + slope_row(field) * CN_PANEL, 0, (field->enc_rows - slope_row(field)) * CN_PANEL * sizeof *d_enc);
        if (params->prior > 0 && cn_field_option_of(field, "eikonal") > 0)
            (void)slope_losses(field, k, params, acts, p, (slope_gradient){ d_enc, d->weights });
    }
}

const cn_field_type cn_field_type_sdf = {
    .name = "sdf",
    .summary = "signed distance on the hash grid, Laplace density, eikonal loss (Yariv et al. 2021)",
    .options = options,
    .n_options = sizeof options / sizeof *options,
    .density = CN_DENSITY_EXP,
    .layout = layout,
    .init = init,
    .prepare = prepare,
    .acts_take = acts_take,
    .encode = encode,
    .encode_backward = encode_backward,
    .position_gradient = position_gradient,
    .logits = logits,
    .distance = distance_of,
    .geometry = geometry,
    .density_pass = density_pass,
    .colour_pass = colour_pass,
    .colour_backward = colour_backward,
    .backward = backward,
    .prior_loss = prior_loss,
};
