/* Voxels without a network (after Fridovich-Keil, Yu et al. 2022, "Plenoxels"). Vertices hold the density and, for
 * each colour, nine spherical harmonics; values are interpolated trilinearly.
 *
 * Sparse: a fine level lies in a hash table of fixed size. Ray marching skips empty space, so only the vertices at
 * surfaces use the table. Coarse to fine: a value is the sum over the levels; fine levels are initialised to 0. Light:
 * when photos have codes, a linear map of the code scales and shifts the colour, so a photo's light is an affine
 * transform of colour. Total variation: see `smooth`. */
#include "base/rng.h"
#include "field/cell.h"
#include "field/field.h"

#include <string.h>

enum { HARMONICS = 9, LIGHT_ROWS = 8, MAX_LEVELS = 8 };

/* A logit is a stored value times this factor, because Adam's steps have the same size for all parameters. */
#define DENSITY_GAIN 8.0f
#define COLOUR_GAIN 2.0f
#define FIRST_LOGIT -2.0f
/* Factor of a level, relative to the next coarser one. Coarse levels learn faster, so what many photos see is learned
 * first. */
#define FINER 0.5f

static const cn_field_option options[] = {
    { "levels", "of voxels, coarse to fine", 1, MAX_LEVELS, { 4, 4, 4, 4, 4 }, true },
    { "log2_table", "vertices of a level, as a power of two", 8, 22, { 16, 18, 18, 20, 11 }, true },
    { "base_resolution", "cells across the tile at the coarsest level", 2, 65536, { 16, 16, 16, 16, 10 }, true },
    { "finest_resolution", "cells across the tile at the finest level", 2, 1048576, { 192, 256, 256, 384, 64 }, true },
    { "total_variation", "weight of the smoothing of density", 0, 1, { 1e-3, 1e-3, 1e-3, 1e-3, 1e-3 }, false },
    { "colour_variation", "weight of the smoothing of colours", 0, 1, { 1e-3, 1e-3, 1e-3, 1e-3, 1e-3 }, false },
};

/* Harmonics per colour; features per vertex; pairs per vertex, padded to whole cache lines. */
static uint32_t harmonics_of(const cn_field *field)
{
    return field->inputs.harmonics >= HARMONICS ? HARMONICS : 1;
}
static uint32_t features_of(const cn_field *field)
{
    return 1 + 3 * harmonics_of(field);
}
static uint32_t pairs_of(const cn_field *field)
{
    return harmonics_of(field) == 1 ? 2 : 16;
}
static bool smooths(const cn_field *field)
{
    return cn_field_option_of(field, "total_variation") > 0 || cn_field_option_of(field, "colour_variation") > 0;
}

static cn_status layout(cn_field *field)
{
    const double log2_table = cn_field_option_of(field, "log2_table");
    const uint32_t levels = (uint32_t)cn_field_option_of(field, "levels");
    if (!(log2_table >= 8 && log2_table <= 22))
        return cn_fail(CN_ERR_CONFIG, "field.log2_table is %g; give 8 to 22", log2_table);
    CN_TRY(cn_grid_layout(&field->grid, levels, (uint32_t)cn_field_option_of(field, "base_resolution"),
                          (uint32_t)cn_field_option_of(field, "finest_resolution"), 1u << (uint32_t)log2_table));
    const uint32_t pairs = pairs_of(field), rows = features_of(field);
    field->geo_rows = rows;
    field->enc_rows = smooths(field) ? 2 * rows : rows; /* forward: density and place; backward: gradients */
    field->conditioning = (field->inputs.n + 3u) & ~3u;
    field->colour_in = rows + field->conditioning;
    field->n_encoders = 1;
    field->n_sections = levels;
    field->entries = field->grid.entries * pairs;
    for (uint32_t l = 0; l < levels; l++)
        field->section[l] =
            (cn_field_section){ field->grid.level[l].offset * pairs, field->grid.level[l].entries * pairs, 0 };
    cn_field_add_block(field, "voxels.table", CN_FIELD_TABLE, field->entries, 2, 0);
    field->n_weights = (size_t)LIGHT_ROWS * field->conditioning;
    if (field->n_weights)
        cn_field_add_block(field, "voxels.light", CN_FIELD_WEIGHTS, LIGHT_ROWS, field->conditioning, 0);
    return CN_OK;
}

static void init(const cn_field *field, uint64_t seed, float *table, float *weights)
{
    for (size_t i = 0; i < 2 * field->entries; i++)
        table[i] = (2 * cn_rng_float(seed, 1, i) - 1) * 1e-4f;
    const float bound = field->conditioning ? sqrtf(3.0f / (float)field->conditioning) : 0;
    for (size_t i = 0; i < field->n_weights; i++)
        weights[i] = (2 * cn_rng_float(seed, 2, i) - 1) * bound;
}

static void prepare(const cn_field *field, const float *weights, float *derived)
{
    (void)field, (void)weights, (void)derived;
}

static void acts_take(const cn_field *field, cn_arena *arena, size_t n_panels, cn_field_acts *acts)
{
    acts->enc = CN_ARENA_NEW(arena, float, n_panels *CN_PANEL * field->enc_rows);
    acts->in = CN_ARENA_NEW(arena, float, n_panels *CN_PANEL * field->colour_in);
    acts->out = CN_ARENA_NEW(arena, float, n_panels *CN_PANEL * 4);
}

/* A vertex of 16 pairs at once. */
typedef float floats __attribute__((vector_size(64)));
typedef uint32_t words __attribute__((vector_size(64)));

/* The sums over a cell of its vertices' first and second features. */
typedef struct sums {
    floats low, high;
} sums;

/* Feature f of the sums, low before high. */
static inline size_t place_of(uint32_t pairs, uint32_t f)
{
    return f / 2 + (f % 2 ? pairs : 0);
}

/* The cells of a position on every level. Their data are prefetched while other cells are looked up. */
static void find_cells(const cn_field *field, const uint32_t *table, const float x[3], cn_cell *cells)
{
    const uint32_t pairs = pairs_of(field);
    for (uint32_t l = 0; l < field->grid.n_levels; l++) {
        const cn_level *level = &field->grid.level[l];
        cn_cell_find(level, x, &cells[l]);
        for (int i = 0; i < 8; i++) {
            cells[l].entry[i] = (level->offset + cells[l].entry[i]) * pairs;
            __builtin_prefetch(table + cells[l].entry[i]);
        }
    }
}

/* All features in these cells: values (axis < 0), or their derivatives along an axis. */
static void look_up(const cn_field *field, const uint32_t *table, const cn_cell *cells, int axis, float sum[32])
{
    const uint32_t pairs = pairs_of(field);
    floats low = { 0 }, high = { 0 };
    float gain = 1;
    for (uint32_t l = 0; l < field->grid.n_levels; l++, gain *= FINER)
        for (int i = 0; i < 8; i++) {
            const float weight = gain * (axis < 0 ? cells[l].weight[i] : cells[l].slope[i][axis]);
            words pair = { 0 };
            memcpy(&pair, table + cells[l].entry[i], pairs == 16 ? sizeof pair : 2 * sizeof *table);
            low += weight * (floats)(pair << 16);
            high += weight * (floats)(pair & 0xffff0000u);
        }
    memcpy(sum, &low, pairs * sizeof *sum);
    memcpy(sum + pairs, &high, pairs * sizeof *sum);
}

/* Only the density, which every sample needs; most samples need no more. Sums in the same order as look_up. */
static float look_up_density(const cn_field *field, const uint32_t *table, const cn_cell *cells)
{
    float gain = 1, density = 0;
    for (uint32_t l = 0; l < field->grid.n_levels; l++, gain *= FINER)
        for (int i = 0; i < 8; i++)
            density += gain * cells[l].weight[i] * cn_bf16_to_float((uint16_t)table[cells[l].entry[i]]);
    return density;
}

/* The cells of a panel's lanes, one lane ahead. rows: the three rows of positions. */
typedef struct walk {
    cn_cell cells[2][MAX_LEVELS];
} walk;
static const cn_cell *walk_to(walk *w, const cn_field *field, const uint32_t *table, const float *rows, size_t lane)
{
    for (size_t next = lane ? lane + 1 : 0; next <= lane + 1 && next < CN_PANEL; next++) {
        const float x[3] = { rows[next], rows[CN_PANEL + next], rows[2 * CN_PANEL + next] };
        find_cells(field, table, x, w->cells[next % 2]);
    }
    return w->cells[lane % 2];
}

/* Density and position. The colours' features are looked up later, for the samples with weight (density_pass). */
static void encode(const cn_field *field, const cn_kernel *k, uint32_t encoder, const cn_field_encoding *of)
{
    (void)k, (void)encoder;
    for (size_t p = 0; p < of->n_panels; p++) {
        const float *place = of->pos + p * 3 * CN_PANEL;
        float *out = of->enc + p * field->enc_rows * CN_PANEL;
        walk w;
        for (size_t lane = 0; lane < CN_PANEL; lane++)
            out[lane] = look_up_density(field, of->table, walk_to(&w, field, of->table, place, lane));
        memcpy(out + CN_PANEL, place, 3 * CN_PANEL * sizeof *out);
        memset(out + (size_t)4 * CN_PANEL, 0, (size_t)(field->enc_rows - 4) * CN_PANEL * sizeof *out);
    }
}

/* Every n-th sample is smoothed, along one axis; the axes take turns. */
enum { SMOOTH_EVERY = 4 };
static int axis_of(size_t sample)
{
    return (int)(sample / SMOOTH_EVERY % 3);
}

/* The gradients of a sample's features, and of their derivatives along its axis: rows of d_enc. */
typedef struct sample_gradient {
    float value[32], slope[32];
} sample_gradient;

static bool read_gradient(const cn_field *field, const float *d, sample_gradient *g)
{
    const uint32_t rows = features_of(field);
    bool any = false, slopes = field->enc_rows > rows;
    memset(g, 0, sizeof *g);
    for (uint32_t f = 0; f < rows; f++) {
        g->value[f] = d[(size_t)f * CN_PANEL];
        if (slopes) g->slope[f] = d[(size_t)(rows + f) * CN_PANEL];
        any = any || g->value[f] != 0 || g->slope[f] != 0;
    }
    return any;
}

/* Adds to the vertex at entry `first` of the level, as far as it lies in the range. */
static void add_vertex(const cn_encode_gradient *in, uint32_t first, uint32_t pairs, const sample_gradient *g,
                       float weight, float along)
{
    const uint32_t begin = in->range->first, end = begin + in->range->count;
    if (first >= begin && first + pairs <= end && pairs == 16) {
        float *grad = in->grad + 2 * (size_t)(first - begin);
        for (int f = 0; f < 32; f++)
            grad[f] += weight * g->value[f] + along * g->slope[f];
        for (uint32_t q = 0; in->touched && q < pairs; q += CN_TOUCH)
            in->touched[(first - begin + q) / CN_TOUCH] = 1;
        return;
    }
    for (uint32_t q = 0; q < pairs; q++) {
        if (first + q < begin || first + q >= end) continue;
        const size_t at = first + q - begin;
        for (size_t f = 0; f < 2; f++)
            in->grad[2 * at + f] += weight * g->value[2 * q + f] + along * g->slope[2 * q + f];
        if (in->touched) in->touched[at / CN_TOUCH] = 1;
    }
}

static void add_sample(const cn_field *field, uint32_t section, const cn_encode_gradient *in, size_t i)
{
    const uint32_t pairs = pairs_of(field), begin = in->range->first, end = begin + in->range->count;
    const float *p = in->pos + i / CN_PANEL * 3 * CN_PANEL + i % CN_PANEL, gain = powf(FINER, (float)section);
    const float x[3] = { p[0], p[CN_PANEL], p[2 * CN_PANEL] };
    const int axis = axis_of(i);
    sample_gradient g;
    cn_cell cell;
    bool inside = false;
    cn_cell_find(&field->grid.level[section], x, &cell);
    for (int c = 0; c < 8; c++)
        inside = inside || (cell.entry[c] * pairs < end && (cell.entry[c] + 1) * pairs > begin);
    if (!inside || !read_gradient(field, in->d_enc + i / CN_PANEL * in->stride + i % CN_PANEL, &g)) return;
    for (int c = 0; c < 8; c++)
        add_vertex(in, cell.entry[c] * pairs, pairs, &g, gain * cell.weight[c], gain * cell.slope[c][axis]);
}

static void encode_backward(const cn_field *field, const cn_kernel *k, const uint32_t *table, uint32_t section,
                            const cn_encode_gradient *in)
{
    (void)k, (void)table;
    for (size_t i = 0; i < in->n_panels * CN_PANEL; i++)
        add_sample(field, section, in, i);
}

static void position_gradient(const cn_field *field, const uint32_t *table, const float *pos, const float *d_enc,
                              uint32_t n, float (*d_pos)[3])
{
    const uint32_t rows = features_of(field), pairs = pairs_of(field);
    for (uint32_t i = 0; i < n; i++) {
        const float *p = pos + (size_t)(i / CN_PANEL) * 3 * CN_PANEL + i % CN_PANEL,
                    *d = d_enc + (size_t)(i / CN_PANEL) * field->enc_rows * CN_PANEL + i % CN_PANEL;
        const float x[3] = { p[0], p[CN_PANEL], p[2 * CN_PANEL] };
        cn_cell cells[MAX_LEVELS];
        find_cells(field, table, x, cells);
        for (int a = 0; a < 3; a++) {
            float slope[32];
            look_up(field, table, cells, a, slope);
            d_pos[i][a] = 0;
            for (uint32_t f = 0; f < rows; f++)
                d_pos[i][a] += d[(size_t)f * CN_PANEL] * slope[place_of(pairs, f)];
        }
    }
}

/* ---- density ---- */

static void panel_geometry(const cn_field *field, const uint32_t *table, const float *enc, float *geo)
{
    const uint32_t pairs = pairs_of(field);
    walk w;
    for (size_t lane = 0; lane < CN_PANEL; lane++) {
        float sum[32];
        look_up(field, table, walk_to(&w, field, table, enc + CN_PANEL, lane), -1, sum);
        geo[lane] = DENSITY_GAIN * enc[lane] + FIRST_LOGIT;
        for (uint32_t f = 1; f < field->geo_rows; f++)
            geo[(size_t)f * CN_PANEL + lane] = COLOUR_GAIN * sum[place_of(pairs, f)];
    }
}

static void logits(const cn_field *field, const cn_kernel *k, const cn_field_params *params, const cn_field_acts *acts,
                   size_t n_panels, float *logit)
{
    (void)k, (void)params;
    for (size_t p = 0; p < n_panels; p++)
        for (size_t lane = 0; lane < CN_PANEL; lane++)
            logit[p * CN_PANEL + lane] = DENSITY_GAIN * acts->enc[p * field->enc_rows * CN_PANEL + lane] + FIRST_LOGIT;
}

static void geometry(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, size_t n_panels, float *geo)
{
    (void)k;
    for (size_t p = 0; p < n_panels; p++)
        panel_geometry(field, params->table, acts->enc + p * field->enc_rows * CN_PANEL,
                       geo + p * field->geo_rows * CN_PANEL);
}

static void density_pass(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                         const cn_field_acts *acts, size_t n_panels)
{
    (void)k;
    for (size_t p = 0; p < n_panels; p++)
        panel_geometry(field, params->table, acts->enc + p * field->enc_rows * CN_PANEL,
                       acts->in + p * field->colour_in * CN_PANEL);
}

/* ---- colour ---- */

/* One panel. base: each colour's sum of harmonics; change: its scale and shift by the light. */
typedef struct panel {
    float base[3][CN_PANEL], change[6][CN_PANEL];
} panel;

/* The first row of the codes in the conditioning, and its end. */
static uint32_t first_code(const cn_field *field)
{
    return field->inputs.harmonics;
}

/* The harmonics of a panel's rays; NULL for the constant one where directions are unknown. */
static const float *harmonic_of(const cn_field *field, const float *in, uint32_t h)
{
    return harmonics_of(field) == 1 ? NULL : in + (size_t)(field->geo_rows + h) * CN_PANEL;
}

static void panel_of(const cn_field *field, const float *weights, const float *in, panel *s)
{
    const uint32_t n = harmonics_of(field);
    memset(s, 0, sizeof *s);
    for (uint32_t c = 0; c < 3; c++)
        for (uint32_t h = 0; h < n; h++) {
            const float *value = in + (size_t)(1 + c * n + h) * CN_PANEL, *y = harmonic_of(field, in, h);
            for (int lane = 0; lane < CN_PANEL; lane++)
                s->base[c][lane] += y ? value[lane] * y[lane] : value[lane];
        }
    for (uint32_t r = 0; r < 6; r++)
        for (uint32_t k = first_code(field); k < field->inputs.n; k++) {
            const float w = weights[(size_t)r * field->conditioning + k],
                        *code = in + (size_t)(field->geo_rows + k) * CN_PANEL;
            for (int lane = 0; lane < CN_PANEL; lane++)
                s->change[r][lane] += w * code[lane];
        }
}

static void colour_pass(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                        const cn_field_acts *acts, size_t n_panels)
{
    (void)k;
    for (size_t p = 0; p < n_panels; p++) {
        panel s;
        float *out = acts->out + p * 4 * CN_PANEL;
        panel_of(field, params->weights, acts->in + p * field->colour_in * CN_PANEL, &s);
        for (size_t c = 0; c < 3; c++)
            for (size_t lane = 0; lane < CN_PANEL; lane++)
                out[c * CN_PANEL + lane] = s.base[c][lane] * (1 + s.change[c][lane]) + s.change[3 + c][lane];
        memset(out + (size_t)3 * CN_PANEL, 0, CN_PANEL * sizeof *out);
    }
}

/* Gradients of one panel's input and, unless dw is NULL, of the light's weights. */
static void panel_backward(const cn_field *field, const float *weights, const float *in, const float *d_out,
                           float *d_in, float *dw)
{
    const uint32_t n = harmonics_of(field);
    panel s, d;
    panel_of(field, weights, in, &s);
    memset(d_in, 0, (size_t)field->colour_in * CN_PANEL * sizeof *d_in);
    for (size_t c = 0; c < 3; c++)
        for (size_t lane = 0; lane < CN_PANEL; lane++) {
            const float g = d_out[c * CN_PANEL + lane];
            d.base[c][lane] = g * (1 + s.change[c][lane]);
            d.change[c][lane] = g * s.base[c][lane];
            d.change[3 + c][lane] = g;
        }
    for (uint32_t c = 0; c < 3; c++)
        for (uint32_t h = 0; h < n; h++) {
            const float *value = in + (size_t)(1 + c * n + h) * CN_PANEL, *y = harmonic_of(field, in, h);
            float *d_value = d_in + (size_t)(1 + c * n + h) * CN_PANEL,
                  *d_y = d_in + (size_t)(field->geo_rows + h) * CN_PANEL;
            for (int lane = 0; lane < CN_PANEL; lane++) {
                d_value[lane] = y ? d.base[c][lane] * y[lane] : d.base[c][lane];
                if (y) d_y[lane] += d.base[c][lane] * value[lane];
            }
        }
    for (uint32_t r = 0; r < 6; r++)
        for (uint32_t k = first_code(field); k < field->inputs.n; k++) {
            const size_t at = (size_t)r * field->conditioning + k, row = (size_t)(field->geo_rows + k) * CN_PANEL;
            float sum = 0;
            for (size_t lane = 0; lane < CN_PANEL; lane++) {
                d_in[row + lane] += weights[at] * d.change[r][lane];
                sum += in[row + lane] * d.change[r][lane];
            }
            if (dw) dw[at] += sum;
        }
}

static void colour_backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                            const cn_field_acts *acts, const cn_field_acts *d, size_t n_panels)
{
    (void)k;
    const size_t in = (size_t)field->colour_in * CN_PANEL;
    for (size_t p = 0; p < n_panels; p++)
        panel_backward(field, params->weights, acts->in + p * in, d->out + p * 4 * CN_PANEL, d->in + p * in, NULL);
}

/* Total variation at the samples with weight: the squared derivative of each feature along an axis, divided by the
 * squared width of a finest cell. The axes take turns. */
static double smooth(const cn_field *field, const cn_field_params *params, const float *enc, float *d_enc,
                     size_t sample)
{
    const uint32_t rows = features_of(field), pairs = pairs_of(field);
    const float width = 1 / (float)field->grid.level[field->grid.n_levels - 1].resolution;
    const float density = 2 * SMOOTH_EVERY * params->prior * width * width *
                          (float)cn_field_option_of(field, "total_variation"),
                colour = 2 * SMOOTH_EVERY * params->prior * width * width *
                         (float)cn_field_option_of(field, "colour_variation");
    const float x[3] = { enc[CN_PANEL], enc[2 * CN_PANEL], enc[3 * CN_PANEL] };
    cn_cell cells[MAX_LEVELS];
    float slope[32];
    find_cells(field, params->table, x, cells);
    look_up(field, params->table, cells, axis_of(sample), slope);
    double sum = 0;
    for (uint32_t f = 0; f < rows; f++) {
        const float by = (f ? colour : density) * slope[place_of(pairs, f)];
        if (d_enc) d_enc[(size_t)(rows + f) * CN_PANEL] = by;
        sum += 0.5 * (double)by * (double)slope[place_of(pairs, f)];
    }
    return sum;
}

static double prior_loss(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                         const cn_field_acts *acts, size_t n_panels)
{
    (void)k;
    double sum = 0;
    for (size_t i = 0; i < n_panels * CN_PANEL; i += SMOOTH_EVERY)
        sum += smooth(field, params, acts->enc + i / CN_PANEL * field->enc_rows * CN_PANEL + i % CN_PANEL, NULL, i);
    return sum;
}

static void backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, const cn_field_gradient *d, size_t n_panels)
{
    (void)k;
    const size_t in = (size_t)field->colour_in * CN_PANEL, enc = (size_t)field->enc_rows * CN_PANEL;
    const size_t features = (size_t)field->geo_rows * CN_PANEL;
    for (size_t p = 0; p < n_panels; p++) {
        float *d_in = d->acts->in + p * in, *d_enc = d->acts->enc + p * enc;
        panel_backward(field, params->weights, acts->in + p * in, d->acts->out + p * 4 * CN_PANEL, d_in, d->weights);
        memset(d_enc, 0, enc * sizeof *d_enc);
        for (size_t lane = 0; lane < CN_PANEL; lane++) {
            d_in[lane] += d->logit[p * CN_PANEL + lane];
            d_enc[lane] = DENSITY_GAIN * d_in[lane];
        }
        for (size_t i = CN_PANEL; i < features; i++)
            d_enc[i] = COLOUR_GAIN * d_in[i];
        if (!(params->prior > 0) || !smooths(field)) continue;
        for (size_t lane = 0; lane < CN_PANEL; lane += SMOOTH_EVERY)
            (void)smooth(field, params, acts->enc + p * enc + lane, d_enc + lane, p * CN_PANEL + lane);
    }
}

const cn_field_type cn_field_type_voxels = {
    .name = "voxels",
    .summary = "sparse voxels of density and spherical harmonics, no network (Fridovich-Keil, Yu et al. 2022)",
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
    .geometry = geometry,
    .density_pass = density_pass,
    .colour_pass = colour_pass,
    .colour_backward = colour_backward,
    .backward = backward,
    .prior_loss = prior_loss,
};
