/* Features on a cloud of points (after Xu et al. 2022, "Point-NeRF"). At a place, the nearest points of each level
 * within a radius count by the inverse of their distance, times a confidence that each point learns. Two small networks
 * give density and colour, as for the hash grid.
 *
 * Some features of a point count times the relative position, so a point describes how its surroundings change.
 * Point-NeRF has a network for each neighbour in their place, which costs eight times as much.
 *
 * The coarsest level covers all space that photos see. The finer ones begin with the sparse points. Between steps they
 * grow where the march meets matter, and lose points in empty space and those with no confidence left. */
#include "base/rng.h"
#include "field/grid_mlp.h"
#include "field/occupancy.h"

#include <string.h>

enum {
    VALUES = 2 * CN_CLOUD_PAIRS,
    CONFIDENCE = VALUES - 1,
    PLAIN = 6 /* features that do not depend on the offset */
};
enum { STREAM_PLACE = 40, STREAM_GROW = 41 };

#define SOFTEST 0.1f   /* added to the distance: a weight stays finite at a point. Not measured apart */
#define ABSENT 0.1f    /* weight of empty space beside the points. Not measured apart */
#define NO_POINT -10.f /* added to the logit where no point is near */
#define CONFIDENCE_GAIN 4.0f
#define FIRST_CONFIDENCE 2.0f
#define LEAST_CONFIDENCE 0.1f /* a point below it is removed (Xu et al. 2022) */
#define MATTER 0.3f           /* part of the light that stops in a cell, from which on points are added */
#define APART 0.5f            /* least distance of points, in radii */

static const cn_field_option options[] = {
    { "levels", "of the cloud, coarse to fine", 1, CN_CLOUD_LEVELS, { 3, 3, 3, 3, 3 }, true },
    { "log2_points", "most points of a level, as a power of two", 8, 22, { 16, 17, 18, 19, 12 }, true },
    { "base_cells",
      "cells across the tile at the coarsest level; a point's radius is half a cell",
      2,
      64,
      { 16, 16, 16, 16, 8 },
      true },
    { "finest_cells", "cells across the tile at the finest level", 2, 1024, { 128, 160, 192, 256, 96 }, true },
    { "neighbours", "nearest points of a level that count at a place", 1, CN_CLOUD_NEAREST, { 8, 8, 8, 8, 8 }, true },
    CN_GRID_MLP_WIDTHS,
};

static cn_status layout(cn_field *field)
{
    static const char *const names[CN_LAYERS] = { "density.0", "density.1", "colour.0", "colour.1", "colour.2" };
    cn_cloud *c = &field->cloud;
    const double log2_points = cn_field_option_of(field, "log2_points"), base = cn_field_option_of(field, "base_cells"),
                 finest = cn_field_option_of(field, "finest_cells");
    c->n_levels = (uint32_t)cn_field_option_of(field, "levels");
    c->neighbours = (uint32_t)cn_field_option_of(field, "neighbours");
    if (c->n_levels < 1 || c->n_levels > CN_CLOUD_LEVELS || c->neighbours < 1 || c->neighbours > CN_CLOUD_NEAREST ||
        !(log2_points >= 8 && log2_points <= 22))
        return cn_fail(CN_ERR_CONFIG, "field.levels, field.neighbours or field.log2_points is out of range");
    if (!(base >= 2 && finest >= base && finest <= 1024))
        return cn_fail(CN_ERR_CONFIG, "field.base_cells is %g and field.finest_cells %g; the finest may not be less",
                       base, finest);
    c->buckets = (1u << (uint32_t)log2_points) / CN_CLOUD_BUCKET;
    for (uint32_t l = 0; l < c->n_levels; l++)
        c->cells[l] = (uint32_t)(base * pow(finest / base, c->n_levels > 1 ? l / (c->n_levels - 1.0) : 0) + 1e-6);
    CN_TRY(cn_mlp_layout(&field->mlp, VALUES * c->n_levels, (uint32_t)cn_field_option_of(field, "density_width"),
                         (uint32_t)cn_field_option_of(field, "colour_width"), field->inputs.n));
    field->enc_rows = field->mlp.enc_rows + ((2 * c->n_levels * c->neighbours + 3) & ~1u);
    field->colour_in = field->mlp.colour_in;
    field->geo_rows = CN_GEO;
    field->conditioning = field->colour_in - CN_GEO;
    field->n_encoders = field->n_sections = c->n_levels;
    const uint32_t values = cn_cloud_slots(c) * CN_CLOUD_PAIRS;
    for (uint32_t l = 0; l < c->n_levels; l++)
        field->section[l] = (cn_field_section){ l * values, values, 0 };
    field->fixed = cn_cloud_place_entries(c);
    field->entries = cn_cloud_value_entries(c) + field->fixed;
    field->n_weights = field->n_derived = field->mlp.n_weights;
    cn_field_add_block(field, "points.features", CN_FIELD_TABLE, cn_cloud_value_entries(c), 2, 0);
    cn_field_add_block(field, "points.places", CN_FIELD_TABLE, field->fixed, 2, cn_cloud_value_entries(c));
    for (int i = 0; i < CN_LAYERS; i++)
        cn_field_add_block(field, names[i], CN_FIELD_WEIGHTS, field->mlp.layer[i].out, field->mlp.layer[i].in,
                           field->mlp.layer[i].offset);
    return CN_OK;
}

/* ---- the cloud ---- */

/* Small features, and no points. */
static void init(const cn_field *field, uint64_t seed, float *table, float *weights)
{
    const size_t values = 2 * cn_cloud_value_entries(&field->cloud);
    for (size_t i = 0; i < values; i++)
        table[i] = (2 * cn_rng_float(seed, 1, i) - 1) * 1e-4f;
    for (size_t i = 0; i < field->fixed; i++) {
        table[values + 2 * i] = 0;
        table[values + 2 * i + 1] = CN_CLOUD_NOWHERE;
    }
    cn_mlp_init(&field->mlp, seed, weights);
}

/* The coarsest level gets points in every usable place, as far as there is room: eight in a cell. */
static void place(const cn_field *field, const cn_field_change *change)
{
    const cn_cloud *c = &field->cloud;
    const uint32_t side = 2 * c->cells[0];
    uint32_t slot;
    for (uint32_t i = 0; i < side * side * side; i++) {
        const uint32_t cell[3] = { i % side, i / side % side, i / side / side };
        float x[3];
        for (uint32_t a = 0; a < 3; a++)
            x[a] = ((float)cell[a] + cn_rng_float(change->seed, STREAM_PLACE, 3 * (size_t)i + a)) / (float)side;
        if (!change->usable || change->usable[cn_occupancy_cell(x[0], x[1], x[2])])
            (void)cn_cloud_insert(c, change->table, 0, x, 0, &slot);
    }
    for (uint32_t l = 1; l < c->n_levels; l++)
        for (size_t i = 0; i < change->n_points; i++)
            (void)cn_cloud_insert(c, change->table, l, change->points[i], APART, &slot);
}

/* The values of a point: first those in the low halves of its pairs, then those in the high halves. */
typedef struct values {
    float v[VALUES];
} values;

static inline values values_of(const cn_cloud *c, const uint32_t *table, uint32_t level, uint32_t slot)
{
    const uint32_t *pair = table + ((size_t)level * cn_cloud_slots(c) + slot) * CN_CLOUD_PAIRS;
    values p;
    for (int q = 0; q < CN_CLOUD_PAIRS; q++) {
        const uint32_t low = pair[q] << 16, high = pair[q] & 0xffff0000u;
        memcpy(&p.v[q], &low, sizeof low);
        memcpy(&p.v[CN_CLOUD_PAIRS + q], &high, sizeof high);
    }
    return p;
}

static inline float confidence_of(const values *p)
{
    return 1 / (1 + expf(-(CONFIDENCE_GAIN * p->v[CONFIDENCE] + FIRST_CONFIDENCE)));
}

/* A new point begins with the features of the nearest one. */
static void grow_at(const cn_field *field, const cn_field_change *change, uint32_t level, const float x[3])
{
    const cn_cloud *c = &field->cloud;
    cn_cloud_near near;
    uint32_t slot;
    float pairs[CN_CLOUD_PAIRS][2] = { { 0 } };
    cn_cloud_find(c, change->table, level, x, &near);
    if (!cn_cloud_insert(c, change->table, level, x, APART, &slot)) return;
    if (near.n) {
        const values of = values_of(c, change->table, level, near.slot[0]);
        for (int q = 0; q < CN_CLOUD_PAIRS; q++)
            pairs[q][0] = of.v[q], pairs[q][1] = of.v[CN_CLOUD_PAIRS + q];
    }
    pairs[CN_CLOUD_PAIRS - 1][1] = 0;
    change->set(change->user, level, slot * CN_CLOUD_PAIRS, CN_CLOUD_PAIRS, (const float(*)[2])pairs);
}

/* Whether a cell that rays march through lies about a place. */
static bool near_matter(const uint32_t *bits, const float x[3], float radius)
{
    const int reach = (int)ceilf(radius * CN_OCC_RES), side = 2 * reach + 1;
    for (int i = 0; i < side * side * side; i++) {
        const int step[3] = { i % side - reach, i / side % side - reach, i / side / side - reach };
        float at[3];
        for (int a = 0; a < 3; a++)
            at[a] = x[a] + (float)step[a] / CN_OCC_RES;
        const uint32_t cell = cn_occupancy_cell(at[0], at[1], at[2]);
        if (bits[cell >> 5] >> (cell & 31) & 1) return true;
    }
    return false;
}

static void prune(const cn_field *field, const cn_field_change *change, uint32_t level)
{
    const cn_cloud *c = &field->cloud;
    for (uint32_t slot = 0; slot < cn_cloud_slots(c); slot++) {
        float x[3];
        if (!cn_cloud_point(c, change->table, level, slot, x)) continue;
        const values p = values_of(c, change->table, level, slot);
        if (confidence_of(&p) < LEAST_CONFIDENCE ||
            (level > 0 && !near_matter(change->bits, x, cn_cloud_radius(c, level))))
            cn_cloud_remove(c, change->table, level, slot);
    }
}

/* A cell that no ray has met yet counts as full (1). */
static void adapt(const cn_field *field, const cn_field_change *change)
{
    const uint64_t stream = (uint64_t)change->step * CN_OCC_CELLS;
    for (uint32_t l = 0; l < field->cloud.n_levels; l++)
        prune(field, change, l);
    for (uint32_t cell = 0; cell < CN_OCC_CELLS; cell++) {
        if (!(change->seen[cell] > MATTER && change->seen[cell] < 1)) continue;
        const uint32_t at[3] = { cell % CN_OCC_RES, cell / CN_OCC_RES % CN_OCC_RES, cell / (CN_OCC_RES * CN_OCC_RES) };
        float x[3];
        for (uint32_t a = 0; a < 3; a++)
            x[a] = ((float)at[a] + cn_rng_float(change->seed, STREAM_GROW, 3 * (stream + cell) + a)) / CN_OCC_RES;
        for (uint32_t l = 0; l < field->cloud.n_levels; l++)
            grow_at(field, change, l, x);
    }
}

/* ---- encoding ---- */

/* One neighbour. What it adds to row v is weight * v[v] * by[v]. */
typedef struct neighbour {
    values of;
    float confidence, near, weight; /* near: the weight at full confidence */
    float by[VALUES];
} neighbour;

typedef struct surroundings {
    cn_cloud_near near;
    neighbour of[CN_CLOUD_NEAREST];
    float sum; /* of the weights, and of empty space */
} surroundings;

/* What the features of a point count times, by its offset. */
static inline void factors(const float offset[3], float by[VALUES])
{
    for (int v = 0; v < VALUES; v++)
        by[v] = v < PLAIN ? 1 : v < CONFIDENCE ? offset[(v - PLAIN) / 3] : 0;
}

static void look_around(const cn_field *field, const uint32_t *table, uint32_t level, const float x[3], surroundings *s)
{
    cn_cloud_find(&field->cloud, table, level, x, &s->near);
    s->sum = ABSENT;
    for (uint32_t i = 0; i < s->near.n; i++) {
        neighbour *p = &s->of[i];
        const float rest = 1 - s->near.square[i];
        p->of = values_of(&field->cloud, table, level, s->near.slot[i]);
        p->confidence = confidence_of(&p->of);
        p->near = rest * rest / sqrtf(s->near.square[i] + SOFTEST * SOFTEST);
        p->weight = p->confidence * p->near;
        factors(s->near.offset[i], p->by);
        s->sum += p->weight;
    }
}

/* Behind the rows of the levels, the place; the other rows have to be 0. */
static void note_place(const cn_field *field, const float *pos, float *enc)
{
    for (size_t row = (size_t)field->cloud.n_levels * VALUES; row < field->enc_rows; row++) {
        const size_t a = row - field->mlp.enc_rows;
        enc[row * CN_PANEL] = a < 3 ? pos[a * CN_PANEL] : 0;
    }
}

static void encode(const cn_field *field, const cn_kernel *k, uint32_t level, const cn_field_encoding *of)
{
    (void)k;
    for (size_t i = 0; i < of->n_panels * CN_PANEL; i++) {
        const float *p = of->pos + i / CN_PANEL * 3 * CN_PANEL + i % CN_PANEL;
        float *out = of->enc + (i / CN_PANEL * field->enc_rows + (size_t)level * VALUES) * CN_PANEL + i % CN_PANEL;
        surroundings s;
        float row[VALUES] = { 0 };
        look_around(field, of->table, level, (float[3]){ p[0], p[CN_PANEL], p[2 * CN_PANEL] }, &s);
        for (uint32_t j = 0; j < s.near.n; j++)
            for (int v = 0; v < VALUES; v++)
                row[v] += s.of[j].weight * s.of[j].of.v[v] * s.of[j].by[v];
        for (size_t v = 0; v < CONFIDENCE; v++)
            out[v * CN_PANEL] = row[v] / s.sum;
        out[(size_t)CONFIDENCE * CN_PANEL] = (s.sum - ABSENT) / s.sum;
        if (level == 0) note_place(field, p, of->enc + i / CN_PANEL * field->enc_rows * CN_PANEL + i % CN_PANEL);
    }
}

/* Gradients of the neighbours' weights, from those of a level's rows; g[VALUES] of the rows. */
static void weight_gradients(const surroundings *s, const float *g, float *d_weight)
{
    float mean = 0;
    for (uint32_t i = 0; i < s->near.n; i++) {
        d_weight[i] = 0;
        for (int v = 0; v < CONFIDENCE; v++)
            d_weight[i] += g[v] * s->of[i].of.v[v] * s->of[i].by[v];
        mean += s->of[i].weight * d_weight[i];
    }
    mean = mean / s->sum - g[CONFIDENCE] * ABSENT / s->sum;
    for (uint32_t i = 0; i < s->near.n; i++)
        d_weight[i] = (d_weight[i] - mean) / s->sum;
}

/* False: all are 0. */
static bool read_gradient(const float *d, float g[VALUES])
{
    bool any = false;
    for (size_t v = 0; v < VALUES; v++) {
        g[v] = d[v * CN_PANEL];
        any = any || g[v] != 0;
    }
    return any;
}

/* While the table is updated, values of other points may change. So `backward` notes for each neighbour its share of
 * the weight and the gradient of its confidence, in rows of their own, in the order of cn_cloud_find. */
static size_t note_row(const cn_field *field, uint32_t level, uint32_t j)
{
    return field->mlp.enc_rows + 2 * ((size_t)level * field->cloud.neighbours + j);
}

static void note_neighbours(const cn_field *field, const uint32_t *table, const float *enc, float *d_enc)
{
    const float *at = enc + (size_t)field->mlp.enc_rows * CN_PANEL;
    const float x[3] = { at[0], at[CN_PANEL], at[2 * CN_PANEL] };
    for (size_t row = field->mlp.enc_rows; row < field->enc_rows; row++)
        d_enc[row * CN_PANEL] = 0;
    for (uint32_t l = 0; l < field->cloud.n_levels; l++) {
        float g[VALUES], d_weight[CN_CLOUD_NEAREST];
        surroundings s;
        if (!read_gradient(d_enc + (size_t)l * VALUES * CN_PANEL, g)) continue;
        look_around(field, table, l, x, &s);
        weight_gradients(&s, g, d_weight);
        for (uint32_t j = 0; j < s.near.n; j++) {
            float *note = d_enc + note_row(field, l, j) * CN_PANEL;
            note[0] = s.of[j].weight / s.sum;
            note[CN_PANEL] = d_weight[j] * s.of[j].weight * (1 - s.of[j].confidence) * CONFIDENCE_GAIN;
        }
    }
}

/* Adds to the gradients of neighbour j, if its slot lies in the range. */
static void add_point(const cn_encode_gradient *in, const cn_cloud_near *near, uint32_t j, const float *g,
                      const float *note)
{
    const uint32_t first = near->slot[j] * CN_CLOUD_PAIRS;
    if (first < in->range->first || first + CN_CLOUD_PAIRS > in->range->first + in->range->count) return;
    float *grad = in->grad + 2 * (size_t)(first - in->range->first), by[VALUES];
    factors(near->offset[j], by);
    for (size_t v = 0; v < CONFIDENCE; v++)
        grad[2 * (v % CN_CLOUD_PAIRS) + v / CN_CLOUD_PAIRS] += note[0] * g[v] * by[v];
    grad[VALUES - 1] += note[CN_PANEL];
    if (in->touched) in->touched[(first - in->range->first) / CN_TOUCH] = 1;
}
_Static_assert((int)CN_CLOUD_PAIRS == (int)CN_TOUCH, "a point is touched as a whole");

static void encode_backward(const cn_field *field, const cn_kernel *k, const uint32_t *table, uint32_t level,
                            const cn_encode_gradient *in)
{
    (void)k;
    for (size_t i = 0; i < in->n_panels * CN_PANEL; i++) {
        const float *p = in->pos + i / CN_PANEL * 3 * CN_PANEL + i % CN_PANEL,
                    *d = in->d_enc + i / CN_PANEL * in->stride + i % CN_PANEL;
        float g[VALUES];
        cn_cloud_near near;
        if (!read_gradient(d + (size_t)level * VALUES * CN_PANEL, g)) continue;
        cn_cloud_find(&field->cloud, table, level, (float[3]){ p[0], p[CN_PANEL], p[2 * CN_PANEL] }, &near);
        for (uint32_t j = 0; j < near.n; j++)
            add_point(in, &near, j, g, d + note_row(field, level, j) * CN_PANEL);
    }
}

/* Adds to d_x the gradient of the place, by one level. */
static void add_place(const surroundings *s, const float *g, float scale, float d_x[3])
{
    float d_weight[CN_CLOUD_NEAREST];
    weight_gradients(s, g, d_weight);
    for (uint32_t i = 0; i < s->near.n; i++) {
        const neighbour *p = &s->of[i];
        const float *u = s->near.offset[i], rest = 1 - s->near.square[i],
                    distance = sqrtf(s->near.square[i] + SOFTEST * SOFTEST),
                    slope = -4 * rest / distance - rest * rest / (distance * distance * distance);
        float d_u[3];
        for (int a = 0; a < 3; a++)
            d_u[a] = d_weight[i] * p->confidence * slope * u[a];
        for (int v = PLAIN; v < CONFIDENCE; v++)
            d_u[(v - PLAIN) / 3] += g[v] * p->of.v[v] * p->weight / s->sum;
        for (int a = 0; a < 3; a++)
            d_x[a] += d_u[a] * scale;
    }
}

static void position_gradient(const cn_field *field, const uint32_t *table, const float *pos, const float *d_enc,
                              uint32_t n, float (*d_pos)[3])
{
    for (uint32_t i = 0; i < n; i++) {
        const float *p = pos + (size_t)(i / CN_PANEL) * 3 * CN_PANEL + i % CN_PANEL,
                    *d = d_enc + (size_t)(i / CN_PANEL) * field->enc_rows * CN_PANEL + i % CN_PANEL;
        memset(d_pos[i], 0, sizeof d_pos[i]);
        for (uint32_t l = 0; l < field->cloud.n_levels; l++) {
            float g[VALUES];
            surroundings s;
            if (!read_gradient(d + (size_t)l * VALUES * CN_PANEL, g)) continue;
            look_around(field, table, l, (float[3]){ p[0], p[CN_PANEL], p[2 * CN_PANEL] }, &s);
            add_place(&s, g, 1 / cn_cloud_radius(&field->cloud, l), d_pos[i]);
        }
    }
}

/* ---- density and colour ---- */

/* Adds to the logits of a panel what they lack where no point is near. enc: a panel of encodings. */
static void add_absence(const cn_field *field, const float *enc, float *logit)
{
    for (size_t lane = 0; lane < CN_PANEL; lane++) {
        float absent = 1;
        for (size_t l = 0; l < field->cloud.n_levels; l++)
            absent *= 1 - enc[(l * VALUES + CONFIDENCE) * CN_PANEL + lane];
        logit[lane] += NO_POINT * absent;
    }
}

static void add_absence_gradient(const cn_field *field, const float *enc, const float *d_logit, float *d_enc)
{
    const size_t n = field->cloud.n_levels;
    for (size_t lane = 0; lane < CN_PANEL; lane++)
        for (size_t l = 0; l < n; l++) {
            float others = 1;
            for (size_t o = 0; o < n; o++)
                if (o != l) others *= 1 - enc[(o * VALUES + CONFIDENCE) * CN_PANEL + lane];
            d_enc[(l * VALUES + CONFIDENCE) * CN_PANEL + lane] -= d_logit[lane] * NO_POINT * others;
        }
}

/* The activations from panel p on. Panels of the encoding have more rows than the networks read, so the networks take
 * one at a time. */
static cn_field_acts acts_at(const cn_field *field, const cn_field_acts *acts, size_t p)
{
    cn_field_acts at = *acts;
    at.enc += p * field->enc_rows * CN_PANEL;
    at.in += p * field->colour_in * CN_PANEL;
    at.out += p * 4 * CN_PANEL;
    at.own[CN_MLP_HIDDEN] += p * field->mlp.density_width * CN_PANEL;
    at.own[CN_MLP_COLOUR0] += p * field->mlp.colour_width * CN_PANEL;
    at.own[CN_MLP_COLOUR1] += p * field->mlp.colour_width * CN_PANEL;
    return at;
}

static void acts_take(const cn_field *field, cn_arena *arena, size_t n_panels, cn_field_acts *acts)
{
    cn_mlp_acts_take(&field->mlp, arena, n_panels, acts);
    acts->enc = CN_ARENA_NEW(arena, float, n_panels *CN_PANEL * field->enc_rows);
}

/* `acts` is scratch of one panel, but for the encodings. */
static cn_field_acts scratch_at(const cn_field *field, const cn_field_acts *acts, size_t p)
{
    cn_field_acts at = *acts;
    at.enc += p * field->enc_rows * CN_PANEL;
    return at;
}

static void logits(const cn_field *field, const cn_kernel *k, const cn_field_params *params, const cn_field_acts *acts,
                   size_t n_panels, float *logit)
{
    for (size_t p = 0; p < n_panels; p++) {
        const cn_field_acts at = scratch_at(field, acts, p);
        cn_grid_mlp_logits(field, k, params, &at, 1, logit + p * CN_PANEL);
        add_absence(field, at.enc, logit + p * CN_PANEL);
    }
}

static void geometry(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, size_t n_panels, float *geo)
{
    for (size_t p = 0; p < n_panels; p++) {
        const cn_field_acts at = scratch_at(field, acts, p);
        cn_grid_mlp_geometry(field, k, params, &at, 1, geo + p * CN_GEO * CN_PANEL);
        add_absence(field, at.enc, geo + p * CN_GEO * CN_PANEL);
    }
}

static void density_pass(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                         const cn_field_acts *acts, size_t n_panels)
{
    for (size_t p = 0; p < n_panels; p++) {
        const cn_field_acts at = acts_at(field, acts, p);
        cn_grid_mlp_density(field, k, params, &at, 1);
        add_absence(field, at.enc, at.in);
    }
}

static void backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, const cn_field_gradient *d, size_t n_panels)
{
    for (size_t p = 0; p < n_panels; p++) {
        const cn_field_acts at = acts_at(field, acts, p), d_at = acts_at(field, d->acts, p);
        cn_grid_mlp_backward(field, k, params, &at, &(cn_field_gradient){ &d_at, d->logit + p * CN_PANEL, d->weights },
                             1);
        add_absence_gradient(field, at.enc, d_at.in, d_at.enc);
        for (size_t lane = 0; lane < CN_PANEL; lane++)
            note_neighbours(field, params->table, at.enc + lane, d_at.enc + lane);
    }
}

const cn_field_type cn_field_type_points = {
    .name = "points",
    .summary = "features on a cloud of points that grows and is pruned (Xu et al. 2022)",
    .options = options,
    .n_options = sizeof options / sizeof *options,
    .density = CN_DENSITY_EXP,
    .layout = layout,
    .init = init,
    .place = place,
    .adapt = adapt,
    .prepare = cn_grid_mlp_prepare,
    .acts_take = acts_take,
    .encode = encode,
    .encode_backward = encode_backward,
    .position_gradient = position_gradient,
    .logits = logits,
    .geometry = geometry,
    .density_pass = density_pass,
    .colour_pass = cn_grid_mlp_colour,
    .colour_backward = cn_grid_mlp_colour_backward,
    .backward = backward,
};
