/* A grid of tiny networks (after Reiser et al. 2021, "KiloNeRF"). Contracted space is divided into cells; a cell that
 * may hold matter has a network of its own, with two hidden layers of 32 units, which gives density and 31 features.
 * Samples are sorted by network, so that a network's weights are read once for many samples.
 *
 * As in the paper the last two layers, which see the direction, follow the features. Unlike there all cells share them:
 * photos' codes are then learned from all of a photo, and one light looks the same in every cell.
 *
 * A field learns from a teacher first (train/distil.h), because tiny networks that learn from photos alone fill empty
 * space. Afterwards it learns from the photos. The squares of each network's last layer are then part of the loss. */
#include "base/rng.h"
#include "field/field.h"
#include "field/occupancy.h"

#include <string.h>

enum {
    HIDDEN = 2,        /* layers, each of CN_TINY units */
    BLOCK = 16,        /* samples of one network that are computed together */
    CHUNK = 1536,      /* samples that are sorted together */
    NETWORK = CN_TINY, /* row of the encoding: 1 + the sample's network, 0 for none; on the way back the weight of its
                          last layer's squares */
    ROWS = CN_TINY + 4,
    SQUARE_EVERY = 8, /* every n-th sample counts for those squares */
    FIRST = 4,        /* inputs before the frequencies: the place in the cell, and 1 */
    MOST_SEEN = 1023
};
#define FIRST_COLOUR 0.05f /* largest weight of the last layer at first: colours begin alike */
enum { COLOUR_HIDDEN };    /* index in cn_field_acts.own */

static const cn_field_option options[] = {
    { "cells", "across the tile; each that may hold matter has a network", 2, 64, { 16, 24, 28, 32, 8 }, true },
    { "log2_networks",
      "most networks, as a power of two; further cells share them",
      4,
      14,
      { 10, 12, 13, 14, 7 },
      true },
    { "cell_frequencies", "of the place in a cell, each twice the one before", 1, 4, { 3, 4, 4, 4, 2 }, true },
    { "colour_units", "of the colour network's hidden layer", 8, 256, { 32, 32, 32, 64, 32 }, true },
    { "last_layer_decay",
      "weight of the squares of each network's last layer",
      0,
      1,
      { 1e-3, 1e-3, 1e-3, 1e-3, 1e-3 },
      false },
    { CN_FIELD_DISTILLED,
      "share of the schedule that learns from the teacher",
      0,
      0.9,
      { 0.4, 0.4, 0.4, 0.4, 0.4 },
      false },
};

static cn_layer add_layer(cn_field *field, const char *name, uint32_t out, uint32_t in)
{
    const cn_layer layer = { out, in, field->n_weights };
    field->n_weights += (size_t)out * in;
    cn_field_add_block(field, name, CN_FIELD_WEIGHTS, out, in, layer.offset);
    return layer;
}

static cn_status layout(cn_field *field)
{
    cn_kilo *s = &field->kilo;
    const double log2_networks = cn_field_option_of(field, "log2_networks");
    const uint32_t units = (uint32_t)cn_field_option_of(field, "colour_units");
    s->cells = (uint32_t)cn_field_option_of(field, "cells");
    s->frequencies = (uint32_t)cn_field_option_of(field, "cell_frequencies");
    if (!(log2_networks >= 4 && log2_networks <= 14 && s->cells >= 2 && s->cells <= 64 && s->frequencies >= 1 &&
          s->frequencies <= 4))
        return cn_fail(CN_ERR_CONFIG, "field.cells, field.log2_networks or field.cell_frequencies is out of range");
    if (units % 4) return cn_fail(CN_ERR_CONFIG, "field.colour_units is %u; give a multiple of 4 from 8 to 256", units);
    s->networks = 1u << (uint32_t)log2_networks;
    s->inputs = FIRST + 6 * s->frequencies;
    s->entries = (s->inputs + HIDDEN * CN_TINY) * CN_TINY_PAIRS;
    field->enc_rows = ROWS;
    field->geo_rows = CN_TINY;
    field->conditioning = (field->inputs.n + 3u) & ~3u;
    field->colour_in = field->geo_rows + field->conditioning;
    field->n_encoders = field->n_sections = 1;
    field->section[0] = (cn_field_section){ 0, s->networks * s->entries, s->entries };
    field->fixed = (size_t)s->cells * s->cells * s->cells;
    field->entries = field->section[0].entries + field->fixed;
    cn_field_add_block(field, "kilo.networks", CN_FIELD_TABLE, field->section[0].entries, 2, 0);
    cn_field_add_block(field, "kilo.cells", CN_FIELD_TABLE, field->fixed, 2, field->section[0].entries);
    s->colour[0] = add_layer(field, "kilo.colour.0", units, field->colour_in);
    s->colour[1] = add_layer(field, "kilo.colour.1", 4, units);
    field->n_derived = field->n_weights;
    return CN_OK;
}

static void init(const cn_field *field, uint64_t seed, float *table, float *weights)
{
    const cn_kilo *s = &field->kilo;
    const size_t first = (size_t)s->inputs * CN_TINY; /* parameters of a network's first layer */
    for (size_t i = 0; i < 2 * (size_t)field->section[0].entries; i++) {
        const size_t in = i % (2 * (size_t)s->entries) < first ? s->inputs : CN_TINY;
        table[i] = (2 * cn_rng_float(seed, 1, i) - 1) * sqrtf(6.0f / (float)in);
    }
    for (size_t i = 2 * (size_t)field->section[0].entries; i < 2 * field->entries; i++)
        table[i] = 0;
    for (int l = 0; l < 2; l++)
        for (size_t i = 0; i < (size_t)s->colour[l].out * s->colour[l].in; i++)
            weights[s->colour[l].offset + i] = (2 * cn_rng_float(seed, 2, s->colour[l].offset + i) - 1) *
                                               (l ? FIRST_COLOUR : sqrtf(6.0f / (float)s->colour[l].in));
}

/* ---- networks of cells ---- */

static uint32_t cell_axis(float x, uint32_t cells)
{
    return x > 0 ? (x < (float)cells ? (uint32_t)x : cells - 1) : 0;
}

static uint32_t cell_of(uint32_t cells, float x, float y, float z)
{
    const float n = (float)cells;
    return cell_axis(x * n, cells) + cells * (cell_axis(y * n, cells) + cells * cell_axis(z * n, cells));
}

/* How many usable cells of the occupancy grid lie in each cell. */
static void count_usable(const cn_kilo *s, const uint8_t *usable, uint32_t *seen)
{
    for (size_t i = 0; i < (size_t)s->cells * s->cells * s->cells; i++)
        seen[i] = usable ? 0 : 1;
    for (uint32_t c = 0; usable && c < CN_OCC_CELLS; c++) {
        if (!usable[c]) continue;
        const float side = 1.0f / CN_OCC_RES;
        uint32_t *of = &seen[cell_of(s->cells, ((float)(c % CN_OCC_RES) + 0.5f) * side,
                                     ((float)(c / CN_OCC_RES % CN_OCC_RES) + 0.5f) * side,
                                     ((float)(c / (CN_OCC_RES * CN_OCC_RES)) + 0.5f) * side)];
        if (*of < MOST_SEEN) ++*of;
    }
}

/* Cells with more usable space come first. Those for which no network is left share by a hash. */
static void place(const cn_field *field, const cn_field_change *change)
{
    const cn_kilo *s = &field->kilo;
    const size_t n = field->fixed;
    uint32_t *cell = change->table + field->section[0].entries, with[MOST_SEEN + 1] = { 0 }, least = MOST_SEEN + 1,
             wanted = 0, used = 0;
    count_usable(s, change->usable, cell);
    for (size_t i = 0; i < n; i++)
        with[cell[i]]++;
    while (least > 1 && wanted + with[least - 1] <= s->networks)
        wanted += with[--least];
    for (size_t i = 0; i < n; i++)
        cell[i] = cell[i] >= least ? used++ : ((uint32_t)i * 2654435761u >> 7) & (s->networks - 1);
}

/* Samples in the order of their networks. */
typedef struct sorted {
    uint32_t n;
    uint16_t at[CHUNK], network[CHUNK]; /* network: of sample at[i] */
} sorted;

/* A stable sort by eight bits of the network. */
static void sort_pass(const sorted *from, sorted *to, int shift)
{
    uint32_t first[257] = { 0 };
    for (uint32_t i = 0; i < from->n; i++)
        first[(from->network[i] >> shift & 255) + 1]++;
    for (int b = 0; b < 256; b++)
        first[b + 1] += first[b];
    for (uint32_t i = 0; i < from->n; i++) {
        const uint32_t to_at = first[from->network[i] >> shift & 255]++;
        to->at[to_at] = from->at[i];
        to->network[to_at] = from->network[i];
    }
    to->n = from->n;
}

/* The samples first .. first + n of positions in panels. */
static void sort_samples(const cn_field *field, const uint32_t *table, const float *pos, size_t first, uint32_t n,
                         sorted *s)
{
    const cn_kilo *kilo = &field->kilo;
    const uint32_t *cell = table + field->section[0].entries;
    sorted other;
    s->n = n;
    for (uint32_t i = 0; i < n; i++) {
        const float *p = pos + (first + i) / CN_PANEL * 3 * CN_PANEL + (first + i) % CN_PANEL;
        s->at[i] = (uint16_t)i;
        s->network[i] =
            (uint16_t)(cell[cell_of(kilo->cells, p[0], p[CN_PANEL], p[2 * CN_PANEL])] & (kilo->networks - 1));
    }
    sort_pass(s, &other, 0);
    sort_pass(&other, s, 8);
}

/* How many samples from i on have the same network, at most BLOCK. */
static uint32_t run_at(const sorted *s, uint32_t i)
{
    uint32_t n = 1;
    while (n < BLOCK && i + n < s->n && s->network[i + n] == s->network[i])
        n++;
    return n;
}

/* ---- one network ---- */

/* Some samples of a network on their way through it; also their gradients on the way back. */
typedef struct pass {
    uint32_t network, n;
    float x[BLOCK][CN_TINY], hidden[HIDDEN][BLOCK][CN_TINY], out[BLOCK][CN_TINY];
    float squares; /* on the way back: the weight of the last layer's squares */
} pass;

static cn_tiny_layer layer_of(const cn_field *field, const uint32_t *table, uint32_t network, uint32_t layer)
{
    const cn_kilo *s = &field->kilo;
    const uint32_t *w = table + (size_t)network * s->entries;
    return (cn_tiny_layer){ layer ? w + ((size_t)s->inputs + (layer - 1) * CN_TINY) * CN_TINY_PAIRS : w,
                            layer ? CN_TINY : s->inputs };
}

/* sin and cos of pi u / 2 for u in [-1, 1], to 1e-6. */
static void quarter_turns(float u, float *s, float *c)
{
    const float q = u * u;
    *s = u * (1.5707963f + q * (-0.64596409f + q * (0.079692621f + q * (-0.0046816333f + q * 0.00016020f))));
    *c = 1 + q * (-1.2337006f + q * (0.25366951f + q * (-0.020863480f + q * (0.00091918f - q * 0.0000247f))));
}

/* The inputs for a place: where it is in its cell, 1, and sines and cosines, axis by axis. */
static void inputs_of(const cn_kilo *kilo, const float *pos, float x[CN_TINY])
{
    for (size_t a = 0; a < 3; a++) {
        const float at = pos[a * CN_PANEL] * (float)kilo->cells,
                    u = fminf(fmaxf(2 * (at - (float)cell_axis(at, kilo->cells)) - 1, -1), 1);
        float s, c, *row = x + FIRST + a * 2 * kilo->frequencies;
        x[a] = u;
        quarter_turns(u, &s, &c);
        for (uint32_t f = 0; f < kilo->frequencies; f++) {
            row[2 * f] = s;
            row[2 * f + 1] = c;
            const float doubled = 2 * s * c;
            c = 1 - 2 * s * s;
            s = doubled;
        }
    }
    x[3] = 1;
}

/* The gradient of the position from that of the inputs. */
static void inputs_backward(const cn_kilo *kilo, const float x[CN_TINY], const float d[CN_TINY], float d_pos[3])
{
    for (size_t a = 0; a < 3; a++) {
        const float *row = x + FIRST + a * 2 * kilo->frequencies, *d_row = d + FIRST + a * 2 * kilo->frequencies;
        float sum = d[a], rate = 1.5707963f;
        for (uint32_t f = 0; f < kilo->frequencies; f++, rate *= 2)
            sum += rate * (d_row[2 * f] * row[2 * f + 1] - d_row[2 * f + 1] * row[2 * f]);
        d_pos[a] = 2 * (float)kilo->cells * sum;
    }
}

static const float *place_of(const float *pos, size_t sample)
{
    return pos + sample / CN_PANEL * 3 * CN_PANEL + sample % CN_PANEL;
}

/* From the inputs to the last hidden layer. */
static void forward(const cn_field *field, const cn_kernel *k, const uint32_t *table, pass *p)
{
    k->tiny(layer_of(field, table, p->network, 0), p->x[0], p->n, true, p->hidden[0][0]);
    k->tiny(layer_of(field, table, p->network, 1), p->hidden[0][0], p->n, true, p->hidden[1][0]);
}

/* From d->out to the gradients of all layers' inputs, d->hidden. */
static void backward_hidden(const cn_field *field, const cn_kernel *k, const uint32_t *table, const pass *p, pass *d)
{
    k->tiny_backward(layer_of(field, table, p->network, 2), d->out[0], p->n, p->hidden[1][0], d->hidden[1][0]);
    k->tiny_backward(layer_of(field, table, p->network, 1), d->hidden[1][0], p->n, p->hidden[0][0], d->hidden[0][0]);
}

static void encode(const cn_field *field, const cn_kernel *k, uint32_t encoder, const cn_field_encoding *of)
{
    (void)encoder;
    const size_t all = of->n_panels * CN_PANEL;
    sorted s;
    pass p;
    for (size_t first = 0; first < all; first += CHUNK) {
        sort_samples(field, of->table, of->pos, first, (uint32_t)(all - first < CHUNK ? all - first : CHUNK), &s);
        for (uint32_t i = 0, n; i < s.n; i += n) {
            p.n = n = run_at(&s, i);
            p.network = s.network[i];
            for (uint32_t j = 0; j < n; j++)
                inputs_of(&field->kilo, place_of(of->pos, first + s.at[i + j]), p.x[j]);
            forward(field, k, of->table, &p);
            k->tiny(layer_of(field, of->table, p.network, 2), p.hidden[1][0], n, false, p.out[0]);
            for (uint32_t j = 0; j < n; j++) {
                const size_t at = first + s.at[i + j];
                float *out = of->enc + at / CN_PANEL * ROWS * CN_PANEL + at % CN_PANEL;
                for (size_t r = 0; r < CN_TINY; r++)
                    out[r * CN_PANEL] = p.out[j][r];
                out[(size_t)NETWORK * CN_PANEL] = 1 + (float)s.network[i];
                for (size_t r = NETWORK + 1; r < ROWS; r++)
                    out[r * CN_PANEL] = 0;
            }
        }
    }
}

/* Rows of gradients of encodings; panels lie `stride` floats apart. */
typedef struct gradient_rows {
    const float *d_enc;
    size_t stride;
} gradient_rows;

/* Reads the gradients of a run's outputs: of d->n samples, at places after the first. False when all are 0. */
static bool read_gradients(const gradient_rows *from, size_t first, const uint16_t *at, pass *d)
{
    bool any = false;
    d->squares = 0;
    for (uint32_t j = 0; j < d->n; j++) {
        const float *row = from->d_enc + (first + at[j]) / CN_PANEL * from->stride + (first + at[j]) % CN_PANEL;
        for (size_t r = 0; r < CN_TINY; r++) {
            d->out[j][r] = row[r * CN_PANEL];
            any = any || d->out[j][r] != 0;
        }
        d->squares += row[(size_t)NETWORK * CN_PANEL];
    }
    return any || d->squares != 0;
}

/* A layer's weight as it stands in the table: parameter i of a pair's two. */
static float weight_at(const uint32_t *w, size_t i)
{
    return cn_bf16_to_float((uint16_t)(i % 2 ? w[i / 2] >> 16 : w[i / 2]));
}

/* Gradients of a network's parameters from a run of samples. grad: of the network's entries. */
static void run_gradient(const cn_field *field, const cn_kernel *k, const uint32_t *table, const pass *p, pass *d,
                         float *grad)
{
    const size_t layer = (size_t)CN_TINY * CN_TINY, first = (size_t)field->kilo.inputs * CN_TINY;
    backward_hidden(field, k, table, p, d);
    k->tiny_gradient(field->kilo.inputs, p->x[0], d->hidden[0][0], p->n, grad);
    k->tiny_gradient(CN_TINY, p->hidden[0][0], d->hidden[1][0], p->n, grad + first);
    k->tiny_gradient(CN_TINY, p->hidden[1][0], d->out[0], p->n, grad + first + layer);
    if (d->squares == 0) return;
    const uint32_t *last = layer_of(field, table, p->network, 2).w;
    for (size_t i = 0; i < layer; i++)
        grad[first + layer + i] += d->squares * weight_at(last, i);
}

/* The range holds whole networks (cn_field_section.together), so no other thread changes the weights that are read. */
static void encode_backward(const cn_field *field, const cn_kernel *k, const uint32_t *table, uint32_t section,
                            const cn_encode_gradient *in)
{
    (void)section;
    const size_t all = in->n_panels * CN_PANEL, entries = field->kilo.entries, begin = in->range->first,
                 end = begin + in->range->count;
    sorted s;
    pass p, d;
    for (size_t first = 0; first < all; first += CHUNK) {
        sort_samples(field, table, in->pos, first, (uint32_t)(all - first < CHUNK ? all - first : CHUNK), &s);
        for (uint32_t i = 0, n; i < s.n; i += n) {
            const size_t of = s.network[i] * entries;
            p.n = d.n = n = run_at(&s, i);
            p.network = s.network[i];
            if (of < begin || of + entries > end) continue;
            if (!read_gradients(&(gradient_rows){ in->d_enc, in->stride }, first, s.at + i, &d)) continue;
            for (uint32_t j = 0; j < n; j++)
                inputs_of(&field->kilo, place_of(in->pos, first + s.at[i + j]), p.x[j]);
            forward(field, k, table, &p);
            run_gradient(field, k, table, &p, &d, in->grad + 2 * (of - begin));
            if (in->touched) memset(in->touched + (of - begin) / CN_TOUCH, 1, entries / CN_TOUCH);
        }
    }
}

static void position_gradient(const cn_field *field, const uint32_t *table, const float *pos, const float *d_enc,
                              uint32_t n, float (*d_pos)[3])
{
    const cn_kernel *k = cn_kernel_best();
    sorted s;
    pass p, d;
    for (uint32_t first = 0; first < n; first += CHUNK) {
        sort_samples(field, table, pos, first, n - first < CHUNK ? n - first : CHUNK, &s);
        for (uint32_t i = 0, run; i < s.n; i += run) {
            p.n = d.n = run = run_at(&s, i);
            p.network = s.network[i];
            (void)read_gradients(&(gradient_rows){ d_enc, (size_t)ROWS * CN_PANEL }, first, s.at + i, &d);
            for (uint32_t j = 0; j < run; j++)
                inputs_of(&field->kilo, place_of(pos, first + s.at[i + j]), p.x[j]);
            forward(field, k, table, &p);
            backward_hidden(field, k, table, &p, &d);
            k->tiny_backward(layer_of(field, table, p.network, 0), d.hidden[0][0], run, NULL, d.x[0]);
            for (uint32_t j = 0; j < run; j++)
                inputs_backward(&field->kilo, p.x[j], d.x[j], d_pos[first + s.at[i + j]]);
        }
    }
}

/* ---- density and colour ---- */

static void prepare(const cn_field *field, const float *weights, float *derived)
{
    for (int l = 0; l < 2; l++) {
        const cn_layer *of = &field->kilo.colour[l];
        for (uint32_t o = 0; o < of->out; o++)
            for (uint32_t i = 0; i < of->in; i++)
                derived[of->offset + (size_t)i * of->out + o] = weights[of->offset + (size_t)o * of->in + i];
    }
}

static void acts_take(const cn_field *field, cn_arena *arena, size_t n_panels, cn_field_acts *acts)
{
    const size_t lanes = n_panels * CN_PANEL;
    acts->enc = CN_ARENA_NEW(arena, float, lanes * field->enc_rows);
    acts->in = CN_ARENA_NEW(arena, float, lanes * field->colour_in);
    acts->out = CN_ARENA_NEW(arena, float, lanes * 4);
    acts->own[COLOUR_HIDDEN] = CN_ARENA_NEW(arena, float, lanes * field->kilo.colour[0].out);
}

static void logits(const cn_field *field, const cn_kernel *k, const cn_field_params *params, const cn_field_acts *acts,
                   size_t n_panels, float *logit)
{
    (void)field, (void)k, (void)params;
    for (size_t p = 0; p < n_panels; p++)
        memcpy(logit + p * CN_PANEL, acts->enc + p * ROWS * CN_PANEL, CN_PANEL * sizeof *logit);
}

static void geometry(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, size_t n_panels, float *geo)
{
    (void)field, (void)k, (void)params;
    const size_t rows = (size_t)CN_TINY * CN_PANEL;
    for (size_t p = 0; p < n_panels; p++)
        memcpy(geo + p * rows, acts->enc + p * ROWS * CN_PANEL, rows * sizeof *geo);
}

static void density_pass(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                         const cn_field_acts *acts, size_t n_panels)
{
    (void)k, (void)params;
    for (size_t p = 0; p < n_panels; p++)
        memcpy(acts->in + p * field->colour_in * CN_PANEL, acts->enc + p * ROWS * CN_PANEL,
               (size_t)CN_TINY * CN_PANEL * sizeof *acts->in);
}

static void colour_pass(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                        const cn_field_acts *acts, size_t n_panels)
{
    const cn_layer *l = field->kilo.colour;
    for (size_t p = 0; p < n_panels; p++) {
        float *hidden = acts->own[COLOUR_HIDDEN] + p * l[0].out * CN_PANEL;
        k->gemm((cn_matrix){ params->derived + l[0].offset, l[0].out, l[0].in },
                acts->in + p * field->colour_in * CN_PANEL, hidden, NULL, true);
        k->gemm((cn_matrix){ params->derived + l[1].offset, l[1].out, l[1].in }, hidden, acts->out + p * 4 * CN_PANEL,
                NULL, false);
    }
}

static void colour_backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                            const cn_field_acts *acts, const cn_field_acts *d, size_t n_panels)
{
    const cn_layer *l = field->kilo.colour;
    for (size_t p = 0; p < n_panels; p++) {
        const size_t hidden = p * l[0].out * CN_PANEL;
        k->gemm((cn_matrix){ params->weights + l[1].offset, l[1].in, l[1].out }, d->out + p * 4 * CN_PANEL,
                d->own[COLOUR_HIDDEN] + hidden, acts->own[COLOUR_HIDDEN] + hidden, false);
        k->gemm((cn_matrix){ params->weights + l[0].offset, l[0].in, l[0].out }, d->own[COLOUR_HIDDEN] + hidden,
                d->in + p * field->colour_in * CN_PANEL, NULL, false);
    }
}

/* A sample's weight of its network's mean square of the last layer; 0 for the empty lanes of a panel. */
static float square_weight(const cn_field *field, const cn_field_params *params, const float *enc, size_t lane)
{
    if (lane % SQUARE_EVERY || !(params->prior > 0) || !(enc[(size_t)NETWORK * CN_PANEL] > 0)) return 0;
    return SQUARE_EVERY * params->prior * (float)cn_field_option_of(field, "last_layer_decay") /
           (float)(CN_TINY * CN_TINY);
}

static double prior_loss(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                         const cn_field_acts *acts, size_t n_panels)
{
    (void)k;
    double sum = 0;
    for (size_t i = 0; i < n_panels * CN_PANEL; i++) {
        const float *enc = acts->enc + i / CN_PANEL * ROWS * CN_PANEL + i % CN_PANEL;
        const double weight = 0.5 * (double)square_weight(field, params, enc, i % CN_PANEL);
        if (weight == 0) continue;
        const uint32_t network = (uint32_t)enc[(size_t)NETWORK * CN_PANEL] - 1,
                       *last = layer_of(field, params->table, network, 2).w;
        for (size_t w = 0; w < (size_t)CN_TINY * CN_TINY; w++)
            sum += weight * (double)weight_at(last, w) * (double)weight_at(last, w);
    }
    return sum;
}

static void backward(const cn_field *field, const cn_kernel *k, const cn_field_params *params,
                     const cn_field_acts *acts, const cn_field_gradient *d, size_t n_panels)
{
    const cn_layer *l = field->kilo.colour;
    const size_t in = (size_t)field->colour_in * CN_PANEL, hidden = (size_t)l[0].out * CN_PANEL;
    colour_backward(field, k, params, acts, d->acts, n_panels);
    k->weight_grad(&(cn_panel_rows){ d->acts->own[COLOUR_HIDDEN], hidden, l[0].out },
                   &(cn_panel_rows){ acts->in, in, l[0].in }, n_panels, d->weights + l[0].offset);
    k->weight_grad(&(cn_panel_rows){ d->acts->out, (size_t)4 * CN_PANEL, 4 },
                   &(cn_panel_rows){ acts->own[COLOUR_HIDDEN], hidden, l[1].in }, n_panels, d->weights + l[1].offset);
    for (size_t p = 0; p < n_panels; p++) {
        float *d_in = d->acts->in + p * in, *d_enc = d->acts->enc + p * ROWS * CN_PANEL;
        for (size_t lane = 0; lane < CN_PANEL; lane++)
            d_in[lane] += d->logit[p * CN_PANEL + lane];
        memcpy(d_enc, d_in, (size_t)CN_TINY * CN_PANEL * sizeof *d_enc);
        memset(d_enc + (size_t)CN_TINY * CN_PANEL, 0, (size_t)(ROWS - CN_TINY) * CN_PANEL * sizeof *d_enc);
        for (size_t lane = 0; lane < CN_PANEL; lane++)
            d_enc[(size_t)NETWORK * CN_PANEL + lane] =
                square_weight(field, params, acts->enc + p * ROWS * CN_PANEL + lane, lane);
    }
}

const cn_field_type cn_field_type_kilo = {
    .name = "kilo",
    .summary = "a grid of tiny networks that learn from a teacher, for fast pictures (Reiser et al. 2021)",
    .options = options,
    .n_options = sizeof options / sizeof *options,
    .density = CN_DENSITY_EXP,
    .table_rate = 1,
    .layout = layout,
    .init = init,
    .prepare = prepare,
    .place = place,
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
