/* Voxels without a network (after Fridovich-Keil, Yu et al. 2022, "Plenoxels"). Vertices hold the density and the
 * colour; those of the coarse levels hold nine spherical harmonics for each colour, those of the finer ones only the
 * constant one. Values are interpolated trilinearly.
 *
 * Sparse: a fine level lies in a hash table of fixed size. Ray marching skips empty space, so only the vertices at
 * surfaces use the table. Coarse to fine: a value is the sum over the levels. Light: when photos have codes, a linear
 * map of the code scales and shifts the colour, so a photo's light is an affine transform of colour. Total variation:
 * see `smooth`.
 *
 * A coarse vertex is 16 pairs, a cache line, looked up at once. A fine level is two tables of pairs, density and red,
 * green and blue, which the kernels of the hash grid read and write. */
#include "base/rng.h"
#include "field/cell.h"
#include "field/field.h"

#include <string.h>

enum { HARMONICS = 9, LIGHT_ROWS = 8, MAX_LEVELS = 8, PAIRS = 16, FEATURES = 1 + 3 * HARMONICS };

/* A logit is a stored value times these, because Adam's steps have the same size for all parameters. The density must
 * not be faster than the colours: else it empties places before they have the colours that would keep them. The fog at
 * first has to be denser than what counts as empty (occupancy.c). Tuned on fox, preview, PSNR of the training photos
 * after 500 steps: gains of 8 and 4 with a first logit of -2 17.9 dB, with 0.5 17.6 dB; 4 and 8 with 0.5 20.3 dB; 2 and
 * 8 with 1 20.6 dB. On castle, after 590 steps, the last have 23.5 dB, and the voxels of before 22.5 dB. */
#define DENSITY_GAIN 2.0f
#define COLOUR_GAIN 8.0f
#define HARMONIC_GAIN (0.3f * COLOUR_GAIN) /* of the harmonics that depend on the direction */
#define FIRST_LOGIT 1.0f
#define FINER 0.8f /* factor of a level, relative to the next coarser one */

static const cn_field_option options[] = {
    { "levels", "of voxels, coarse to fine", 1, MAX_LEVELS, { 6, 6, 6, 7, 6 }, true },
    { "harmonic_levels",
      "the coarsest levels, whose colours depend on the direction",
      1,
      MAX_LEVELS,
      { 2, 2, 2, 2, 1 },
      true },
    { "log2_table", "vertices of a level, as a power of two", 8, 22, { 18, 19, 19, 20, 13 }, true },
    { "base_resolution", "cells across the tile at the coarsest level", 2, 65536, { 16, 16, 16, 16, 10 }, true },
    { "finest_resolution",
      "cells across the tile at the finest level",
      2,
      1048576,
      { 512, 768, 768, 1024, 128 },
      true },
    { "total_variation",
      "weight of the smoothing of the coarse levels' density",
      0,
      1,
      { 1e-3, 1e-3, 1e-3, 1e-3, 1e-3 },
      false },
};

/* Without directions, there are no coarse levels. */
static uint32_t coarse_of(const cn_field *field)
{
    const uint32_t coarse = (uint32_t)cn_field_option_of(field, "harmonic_levels");
    if (field->inputs.harmonics < HARMONICS) return 0;
    return coarse < field->grid.n_levels ? coarse : field->grid.n_levels;
}
static uint32_t harmonics_of(const cn_field *field)
{
    return coarse_of(field) ? HARMONICS : 1;
}
static uint32_t features_of(const cn_field *field)
{
    return 1 + 3 * harmonics_of(field);
}
static float gain_of(uint32_t level)
{
    float gain = 1;
    for (uint32_t l = 0; l < level; l++)
        gain *= FINER;
    return gain;
}
/* Of a coarse level's feature f. */
static float gain_of_colour(uint32_t f)
{
    return (f - 1) % HARMONICS ? HARMONIC_GAIN : COLOUR_GAIN;
}
/* Feature c of a fine level, density and colours, among all features. */
static uint32_t feature_of(const cn_field *field, uint32_t c)
{
    return c ? 1 + (c - 1) * harmonics_of(field) : 0;
}

/* Rows of the encoding. Forward: the coarse levels' density, the position, and from fine_row on what each fine level
 * holds. Backward: gradients of the coarse levels' features, of their density's derivative along an axis, and of the
 * fine levels' features. */
enum { PLACE_ROW = 1, SMOOTH_ROW = FEATURES };
static uint32_t fine_row(const cn_field *field, uint32_t level)
{
    const uint32_t coarse = coarse_of(field);
    return (coarse ? FEATURES + 4 : 4) + 4 * (level - coarse);
}
static const cn_level *level_of(const cn_field *field, uint32_t section, uint32_t *level)
{
    const uint32_t coarse = coarse_of(field);
    *level = section < coarse ? section : coarse + (section - coarse) / 2;
    return &field->grid.level[*level];
}

static cn_status layout(cn_field *field)
{
    const double log2_table = cn_field_option_of(field, "log2_table");
    const uint32_t levels = (uint32_t)cn_field_option_of(field, "levels");
    if (!(log2_table >= 8 && log2_table <= 22))
        return cn_fail(CN_ERR_CONFIG, "field.log2_table is %g; give 8 to 22", log2_table);
    CN_TRY(cn_grid_layout(&field->grid, levels, (uint32_t)cn_field_option_of(field, "base_resolution"),
                          (uint32_t)cn_field_option_of(field, "finest_resolution"), 1u << (uint32_t)log2_table));
    const uint32_t coarse = coarse_of(field);
    field->geo_rows = features_of(field);
    field->enc_rows = fine_row(field, levels);
    field->conditioning = (field->inputs.n + 3u) & ~3u;
    field->colour_in = field->geo_rows + field->conditioning;
    field->n_sections = coarse + 2 * (levels - coarse);
    field->n_encoders = 1 + 2 * (levels - coarse);
    field->entries = 0;
    for (uint32_t s = 0, l; s < field->n_sections; s++) {
        const uint32_t entries = level_of(field, s, &l)->entries * (s < coarse ? PAIRS : 1);
        field->section[s] = (cn_field_section){ (uint32_t)field->entries, entries, s < coarse ? PAIRS : 0 };
        field->entries += entries;
    }
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

/* ---- coarse levels ---- */

/* A coarse vertex at once. */
typedef float floats __attribute__((vector_size(64)));
typedef uint32_t words __attribute__((vector_size(64)));

/* Feature f of the sums, low before high. */
static inline size_t place_of(uint32_t f)
{
    return f / 2 + (f % 2 ? PAIRS : 0);
}

/* The cells of a position on every coarse level. Their data are prefetched while other cells are looked up. */
static void find_cells(const cn_field *field, const uint32_t *table, const float x[3], cn_cell *cells)
{
    for (uint32_t l = 0; l < coarse_of(field); l++) {
        cn_cell_find(&field->grid.level[l], x, &cells[l]);
        for (int i = 0; i < 8; i++) {
            cells[l].entry[i] = field->section[l].first + cells[l].entry[i] * PAIRS;
            __builtin_prefetch(table + cells[l].entry[i]);
        }
    }
}

/* All features in these cells: values (axis < 0), or their derivatives along an axis. */
static void look_up(const cn_field *field, const uint32_t *table, const cn_cell *cells, int axis, float sum[32])
{
    floats low = { 0 }, high = { 0 };
    for (uint32_t l = 0; l < coarse_of(field); l++)
        for (int i = 0; i < 8; i++) {
            const float weight = gain_of(l) * (axis < 0 ? cells[l].weight[i] : cells[l].slope[i][axis]);
            words pair;
            memcpy(&pair, table + cells[l].entry[i], sizeof pair);
            low += weight * (floats)(pair << 16);
            high += weight * (floats)(pair & 0xffff0000u);
        }
    memcpy(sum, &low, sizeof low);
    memcpy(sum + PAIRS, &high, sizeof high);
}

/* Only the density, which every sample needs; most samples need no more. Sums in the same order as look_up.
 * axis: as there. */
static float look_up_density(const cn_field *field, const uint32_t *table, const cn_cell *cells, int axis)
{
    float density = 0;
    for (uint32_t l = 0; l < coarse_of(field); l++)
        for (int i = 0; i < 8; i++)
            density += gain_of(l) * (axis < 0 ? cells[l].weight[i] : cells[l].slope[i][axis]) *
                       cn_bf16_to_float((uint16_t)table[cells[l].entry[i]]);
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

/* The coarse levels' density and the position. Their colours are looked up later, for the samples with weight
 * (density_pass). */
static void encode_coarse(const cn_field *field, const cn_field_encoding *of)
{
    const uint32_t begin = PLACE_ROW + 3, end = coarse_of(field) ? fine_row(field, coarse_of(field)) : begin;
    for (size_t p = 0; p < of->n_panels; p++) {
        const float *place = of->pos + p * 3 * CN_PANEL;
        float *out = of->enc + p * field->enc_rows * CN_PANEL;
        walk w;
        for (size_t lane = 0; lane < CN_PANEL; lane++)
            out[lane] = look_up_density(field, of->table, walk_to(&w, field, of->table, place, lane), -1);
        memcpy(out + (size_t)PLACE_ROW * CN_PANEL, place, 3 * CN_PANEL * sizeof *out);
        memset(out + (size_t)begin * CN_PANEL, 0, (size_t)(end - begin) * CN_PANEL * sizeof *out);
    }
}

/* Encoder 0 is for the coarse levels; then there is one for each table of a fine level. */
static void encode(const cn_field *field, const cn_kernel *k, uint32_t encoder, const cn_field_encoding *of)
{
    if (!encoder) {
        encode_coarse(field, of);
        return;
    }
    const uint32_t section = coarse_of(field) + encoder - 1;
    uint32_t l;
    const cn_level *level = level_of(field, section, &l);
    const size_t row = fine_row(field, l) + 2 * ((encoder - 1) % 2);
    k->encode(level, of->table + field->section[section].first, of->pos, of->n_panels, of->enc + row * CN_PANEL,
              (size_t)field->enc_rows * CN_PANEL);
}

/* Every n-th sample is smoothed, along one axis; the axes take turns. */
enum { SMOOTH_EVERY = 4 };
static int axis_of(size_t sample)
{
    return (int)(sample / SMOOTH_EVERY % 3);
}

/* Adds the gradients of sample i to a coarse level. */
static void add_sample(const cn_level *level, float gain, const cn_encode_gradient *in, size_t i)
{
    const uint32_t begin = in->range->first, end = begin + in->range->count;
    const float *p = in->pos + i / CN_PANEL * 3 * CN_PANEL + i % CN_PANEL,
                *d = in->d_enc + i / CN_PANEL * in->stride + i % CN_PANEL;
    const float x[3] = { p[0], p[CN_PANEL], p[2 * CN_PANEL] }, slope = d[(size_t)SMOOTH_ROW * CN_PANEL];
    const int axis = axis_of(i);
    float value[2 * PAIRS] = { 0 };
    bool any = slope != 0;
    cn_cell cell;
    for (uint32_t f = 0; f < FEATURES; f++) {
        value[f] = d[(size_t)f * CN_PANEL];
        any = any || value[f] != 0;
    }
    if (!any) return;
    cn_cell_find(level, x, &cell);
    for (int c = 0; c < 8; c++) {
        const uint32_t first = cell.entry[c] * PAIRS;
        if (first < begin || first >= end) continue;
        float *grad = in->grad + 2 * (size_t)(first - begin);
        const float weight = gain * cell.weight[c];
        for (int f = 0; f < 2 * PAIRS; f++)
            grad[f] += weight * value[f];
        grad[0] += gain * cell.slope[c][axis] * slope;
        for (uint32_t q = 0; in->touched && q < PAIRS; q += CN_TOUCH)
            in->touched[(first - begin + q) / CN_TOUCH] = 1;
    }
}

static void encode_backward(const cn_field *field, const cn_kernel *k, const uint32_t *table, uint32_t section,
                            const cn_encode_gradient *in)
{
    uint32_t l;
    const cn_level *level = level_of(field, section, &l);
    (void)table;
    if (section >= coarse_of(field)) {
        cn_encode_gradient of_table = *in;
        of_table.d_enc += (size_t)(fine_row(field, l) + 2 * ((section - coarse_of(field)) % 2)) * CN_PANEL;
        k->encode_backward(level, &of_table);
        return;
    }
    for (size_t i = 0; i < in->n_panels * CN_PANEL; i++)
        add_sample(level, gain_of(l), in, i);
}

static void position_gradient(const cn_field *field, const uint32_t *table, const float *pos, const float *d_enc,
                              uint32_t n, float (*d_pos)[3])
{
    for (uint32_t i = 0; i < n; i++) {
        const float *p = pos + (size_t)(i / CN_PANEL) * 3 * CN_PANEL + i % CN_PANEL,
                    *d = d_enc + (size_t)(i / CN_PANEL) * field->enc_rows * CN_PANEL + i % CN_PANEL;
        const float x[3] = { p[0], p[CN_PANEL], p[2 * CN_PANEL] };
        cn_cell cells[MAX_LEVELS];
        d_pos[i][0] = d_pos[i][1] = d_pos[i][2] = 0;
        find_cells(field, table, x, cells);
        for (int a = 0; a < 3 && coarse_of(field); a++) {
            float slope[2 * PAIRS];
            look_up(field, table, cells, a, slope);
            for (uint32_t f = 0; f < FEATURES; f++)
                d_pos[i][a] += d[(size_t)f * CN_PANEL] * slope[place_of(f)];
        }
        for (uint32_t s = coarse_of(field), l; s < field->n_sections; s++) {
            const cn_level *level = level_of(field, s, &l);
            const float *by = d + (size_t)(fine_row(field, l) + 2 * ((s - coarse_of(field)) % 2)) * CN_PANEL;
            cn_cell_find(level, x, cells);
            for (int c = 0; c < 8; c++) {
                const uint32_t pair = table[field->section[s].first + cells->entry[c]];
                const float value =
                    by[0] * cn_bf16_to_float((uint16_t)pair) + by[CN_PANEL] * cn_bf16_to_float((uint16_t)(pair >> 16));
                for (int a = 0; a < 3; a++)
                    d_pos[i][a] += value * cells->slope[c][a];
            }
        }
    }
}

/* ---- density ---- */

/* logit[CN_PANEL] of a panel. */
static void panel_logits(const cn_field *field, const float *enc, float *logit)
{
    for (size_t lane = 0; lane < CN_PANEL; lane++)
        logit[lane] = DENSITY_GAIN * enc[lane] + FIRST_LOGIT;
    for (uint32_t l = coarse_of(field); l < field->grid.n_levels; l++) {
        const float gain = DENSITY_GAIN * gain_of(l), *row = enc + (size_t)fine_row(field, l) * CN_PANEL;
        for (size_t lane = 0; lane < CN_PANEL; lane++)
            logit[lane] += gain * row[lane];
    }
}

static void panel_geometry(const cn_field *field, const uint32_t *table, const float *enc, float *geo)
{
    walk w;
    panel_logits(field, enc, geo);
    memset(geo + CN_PANEL, 0, (size_t)(field->geo_rows - 1) * CN_PANEL * sizeof *geo);
    for (size_t lane = 0; lane < CN_PANEL && coarse_of(field); lane++) {
        float sum[2 * PAIRS];
        look_up(field, table, walk_to(&w, field, table, enc + (size_t)PLACE_ROW * CN_PANEL, lane), -1, sum);
        for (uint32_t f = 1; f < FEATURES; f++)
            geo[(size_t)f * CN_PANEL + lane] = gain_of_colour(f) * sum[place_of(f)];
    }
    for (uint32_t l = coarse_of(field); l < field->grid.n_levels; l++)
        for (uint32_t c = 1; c < 4; c++) {
            const float gain = COLOUR_GAIN * gain_of(l), *row = enc + (size_t)(fine_row(field, l) + c) * CN_PANEL;
            float *to = geo + (size_t)feature_of(field, c) * CN_PANEL;
            for (size_t lane = 0; lane < CN_PANEL; lane++)
                to[lane] += gain * row[lane];
        }
}

static void logits(const cn_field *field, const cn_kernel *k, const cn_field_params *params, const cn_field_acts *acts,
                   size_t n_panels, float *logit)
{
    (void)k, (void)params;
    for (size_t p = 0; p < n_panels; p++)
        panel_logits(field, acts->enc + p * field->enc_rows * CN_PANEL, logit + p * CN_PANEL);
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

/* Total variation at the samples with weight: the squared derivative of the coarse levels' density along an axis,
 * divided by the squared width of a finest cell. The axes take turns. */
static double smooth(const cn_field *field, const cn_field_params *params, const float *enc, float *d_enc,
                     size_t sample)
{
    const float width = 1 / (float)field->grid.level[field->grid.n_levels - 1].resolution;
    const float weight =
        2 * SMOOTH_EVERY * params->prior * width * width * (float)cn_field_option_of(field, "total_variation");
    const float x[3] = { enc[CN_PANEL], enc[2 * CN_PANEL], enc[3 * CN_PANEL] };
    cn_cell cells[MAX_LEVELS];
    find_cells(field, params->table, x, cells);
    const float slope = look_up_density(field, params->table, cells, axis_of(sample)), by = weight * slope;
    if (d_enc) d_enc[(size_t)SMOOTH_ROW * CN_PANEL] = by;
    return 0.5 * (double)by * (double)slope;
}

static bool smooths(const cn_field *field)
{
    return coarse_of(field) && cn_field_option_of(field, "total_variation") > 0;
}

static double prior_loss(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                         const cn_field_acts *acts, size_t n_panels)
{
    (void)k;
    double sum = 0;
    for (size_t i = 0; smooths(field) && i < n_panels * CN_PANEL; i += SMOOTH_EVERY)
        sum += smooth(field, params, acts->enc + i / CN_PANEL * field->enc_rows * CN_PANEL + i % CN_PANEL, NULL, i);
    return sum;
}

/* From the gradients of a panel's features to those of its encoding. */
static void encoding_backward(const cn_field *field, const float *d_in, float *d_enc)
{
    memset(d_enc, 0, (size_t)field->enc_rows * CN_PANEL * sizeof *d_enc);
    for (size_t f = 0; coarse_of(field) && f < FEATURES; f++)
        for (size_t lane = 0; lane < CN_PANEL; lane++)
            d_enc[f * CN_PANEL + lane] = (f ? gain_of_colour(f) : DENSITY_GAIN) * d_in[f * CN_PANEL + lane];
    for (uint32_t l = coarse_of(field); l < field->grid.n_levels; l++)
        for (uint32_t c = 0; c < 4; c++) {
            const float gain = (c ? COLOUR_GAIN : DENSITY_GAIN) * gain_of(l),
                        *from = d_in + (size_t)feature_of(field, c) * CN_PANEL;
            float *to = d_enc + (size_t)(fine_row(field, l) + c) * CN_PANEL;
            for (size_t lane = 0; lane < CN_PANEL; lane++)
                to[lane] = gain * from[lane];
        }
}

static void backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, const cn_field_gradient *d, size_t n_panels)
{
    (void)k;
    const size_t in = (size_t)field->colour_in * CN_PANEL, enc = (size_t)field->enc_rows * CN_PANEL;
    for (size_t p = 0; p < n_panels; p++) {
        float *d_in = d->acts->in + p * in, *d_enc = d->acts->enc + p * enc;
        panel_backward(field, params->weights, acts->in + p * in, d->acts->out + p * 4 * CN_PANEL, d_in, d->weights);
        for (size_t lane = 0; lane < CN_PANEL; lane++)
            d_in[lane] += d->logit[p * CN_PANEL + lane];
        encoding_backward(field, d_in, d_enc);
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
