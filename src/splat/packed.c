#include "splat/packed.h"

#include "base/rng.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SQRT_HALF 0.70710678118654752440f
#define MOST_GROWTH 2.0
#define WIDEST_LOG 11.0f /* a chunk's largest deviation is at most exp(11) times its smallest */

/* ---- order ---- */

typedef struct ranked {
    double key;
    uint32_t which;
} ranked;

static int by_key(const void *a, const void *b)
{
    const ranked *x = a, *y = b;
    if (x->key != y->key) return x->key < y->key ? -1 : 1;
    return x->which < y->which ? -1 : x->which > y->which;
}

static double away_from(const cn_splats *s, size_t i, const double place[3])
{
    double sum = 0;
    for (int k = 0; k < 3; k++)
        sum += ((double)s->centre[i][k] - place[k]) * ((double)s->centre[i][k] - place[k]);
    return sqrt(sum);
}

static int by_value(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return x < y ? -1 : x > y;
}

/* Medians of the centres' coordinates, and of their distances from that place. room: [s->n]. */
static void find_middle(const cn_splats *s, float *room, double middle[4])
{
    for (int k = 0; k < 3; k++) {
        for (size_t i = 0; i < s->n; i++)
            room[i] = s->centre[i][k];
        qsort(room, s->n, sizeof *room, by_value);
        middle[k] = s->n ? (double)room[s->n / 2] : 0;
    }
    for (size_t i = 0; i < s->n; i++)
        room[i] = (float)away_from(s, i, middle);
    qsort(room, s->n, sizeof *room, by_value);
    middle[3] = s->n ? (double)room[s->n / 2] : 0;
}

/* About how large it looks from the middle: the sky's Gaussians are large, but far. */
static double weight_of(const cn_splats *s, size_t i, const double middle[4])
{
    const double a = (double)s->scale[i][0], b = (double)s->scale[i][1], c = (double)s->scale[i][2];
    const double face = fmax(fmax(a * b, b * c), a * c); /* its largest section */
    const double far = fmax(hypot(away_from(s, i, middle), middle[3]), 1e-12);
    return fmax((double)s->opacity[i] * sqrt(face) / far, 1e-12);
}

cn_status cn_splats_rank(const cn_splats *s, uint32_t **order)
{
    ranked *list = malloc((s->n + 1) * sizeof *list);
    float *room = malloc((s->n + 1) * sizeof *room);
    double middle[4];
    *order = malloc((s->n + 1) * sizeof **order);
    if (!list || !room || !*order) {
        free(list);
        free(room);
        free(*order);
        *order = NULL;
        return cn_fail(CN_ERR_NOMEM, "out of memory for the order of %zu splats", s->n);
    }
    find_middle(s, room, middle);
    free(room);
    for (size_t i = 0; i < s->n; i++)
        list[i] = (ranked){ -log((double)cn_rng_float(1, 0, i) + 0x1p-25) / weight_of(s, i, middle), (uint32_t)i };
    qsort(list, s->n, sizeof *list, by_key);
    for (size_t i = 0; i < s->n; i++)
        (*order)[i] = list[i].which;
    free(list);
    return CN_OK;
}

float cn_splats_growth(size_t all, size_t n)
{
    return (float)fmin(sqrt((double)all / (double)n), MOST_GROWTH);
}

cn_status cn_splats_take(const cn_splats *s, const uint32_t *which, size_t n, float grow, cn_splats **out)
{
    const size_t row = (size_t)(s->degree + 1) * (s->degree + 1) * 3;
    CN_TRY(cn_splats_create(out, n, s->degree));
    memcpy((*out)->origin, s->origin, sizeof s->origin);
    for (size_t i = 0; i < n; i++) {
        memcpy((*out)->centre[i], s->centre[which[i]], sizeof s->centre[0]);
        memcpy((*out)->rotation[i], s->rotation[which[i]], sizeof s->rotation[0]);
        memcpy((*out)->colour + i * row, s->colour + which[i] * row, row * sizeof *s->colour);
        (*out)->opacity[i] = s->opacity[which[i]];
        for (int k = 0; k < 3; k++)
            (*out)->scale[i][k] = grow * s->scale[which[i]][k];
    }
    return CN_OK;
}

/* Bits of v with two zeros between each. */
static uint64_t spread_bits(uint64_t v)
{
    v &= 0x1fffff;
    v = (v | v << 32) & UINT64_C(0x1f00000000ffff);
    v = (v | v << 16) & UINT64_C(0x1f0000ff0000ff);
    v = (v | v << 8) & UINT64_C(0x100f00f00f00f00f);
    v = (v | v << 4) & UINT64_C(0x10c30c30c30c30c3);
    return (v | v << 2) & UINT64_C(0x1249249249249249);
}

typedef struct placed {
    uint64_t key;
    uint32_t which;
} placed;

static int by_place(const void *a, const void *b)
{
    const placed *x = a, *y = b;
    if (x->key != y->key) return x->key < y->key ? -1 : 1;
    return x->which < y->which ? -1 : x->which > y->which;
}

/* Along a Morton curve, so that those of a block are neighbours. */
static cn_status sort_by_place(const cn_splats *s, uint32_t *which, uint32_t n)
{
    placed *list = malloc((n + (size_t)1) * sizeof *list);
    if (!list) return cn_fail(CN_ERR_NOMEM, "out of memory for a chunk of %u splats", n);
    float low[3], high[3], widest = 0;
    for (int k = 0; k < 3; k++) {
        low[k] = high[k] = s->centre[which[0]][k];
        for (uint32_t i = 1; i < n; i++) {
            low[k] = fminf(low[k], s->centre[which[i]][k]);
            high[k] = fmaxf(high[k], s->centre[which[i]][k]);
        }
        widest = fmaxf(widest, high[k] - low[k]);
    }
    for (uint32_t i = 0; i < n; i++) {
        list[i] = (placed){ 0, which[i] };
        for (int k = 0; k < 3; k++) {
            const double share = (double)(s->centre[which[i]][k] - low[k]) / fmax((double)widest, 1e-30);
            list[i].key |= spread_bits((uint64_t)(share * 2097151)) << k;
        }
    }
    qsort(list, n, sizeof *list, by_place);
    for (uint32_t i = 0; i < n; i++)
        which[i] = list[i].which;
    free(list);
    return CN_OK;
}

/* ---- bytes ---- */

static uint8_t *put_u32(uint8_t *at, uint32_t v)
{
    for (int b = 0; b < 4; b++)
        *at++ = (uint8_t)(v >> (8 * b));
    return at;
}

static uint8_t *put_float(uint8_t *at, float v)
{
    uint32_t bits;
    memcpy(&bits, &v, sizeof bits);
    return put_u32(at, bits);
}

/* The nearest of 0 to most. */
static uint32_t step_of(double v, double most)
{
    return (uint32_t)lround(fmin(fmax(v, 0), most));
}

static uint32_t pack_rotation(const float q[4])
{
    unsigned largest = 0;
    for (unsigned k = 1; k < 4; k++)
        if (fabsf(q[k]) > fabsf(q[largest])) largest = k;
    const float sign = q[largest] < 0 ? -1 : 1;
    uint32_t out = (uint32_t)largest << 30, shift = 0;
    for (unsigned k = 0; k < 4; k++)
        if (k != largest) {
            out |= step_of((double)(sign * q[k] * SQRT_HALF + 0.5f) * 1023, 1023) << shift;
            shift += 10;
        }
    return out;
}

typedef struct chunk {
    const cn_packing *p;
    const uint32_t *which;
    uint32_t n;
    float log_low, log_step;
} chunk;

static float log_of(const chunk *c, uint32_t i, int k)
{
    return logf(fmaxf(c->p->splats->scale[c->which[i]][k], 1e-30f));
}

static void measure_scales(chunk *c)
{
    float low = INFINITY, high = -INFINITY;
    for (uint32_t i = 0; i < c->n; i++)
        for (int k = 0; k < 3; k++) {
            low = fminf(low, log_of(c, i, k));
            high = fmaxf(high, log_of(c, i, k));
        }
    c->log_low = fmaxf(low, high - WIDEST_LOG);
    c->log_step = (high - c->log_low) / 255;
}

static uint8_t *put_header(const chunk *c, uint8_t *at)
{
    memcpy(at, "CNSP\1\0", 6);
    at[6] = (uint8_t)c->p->degree;
    at[7] = (uint8_t)c->p->n_lights;
    at = put_u32(at + 8, c->n);
    at = put_float(at, c->log_low);
    at = put_float(at, c->log_step);
    at = put_float(at, c->p->harmonics);
    at = put_u32(at, CN_PACKED_BLOCK);
    return put_u32(at, 0);
}

/* Boxes of all blocks at `boxes`, and centres at `centres`. */
static void put_places(const chunk *c, uint8_t *boxes, uint8_t *centres)
{
    const cn_splats *s = c->p->splats;
    for (uint32_t first = 0; first < c->n; first += CN_PACKED_BLOCK) {
        const uint32_t end = first + CN_PACKED_BLOCK < c->n ? first + CN_PACKED_BLOCK : c->n;
        double low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY };
        float box[6];
        for (uint32_t i = first; i < end; i++)
            for (int k = 0; k < 3; k++) {
                low[k] = fmin(low[k], s->origin[k] + (double)s->centre[c->which[i]][k]);
                high[k] = fmax(high[k], s->origin[k] + (double)s->centre[c->which[i]][k]);
            }
        for (int k = 0; k < 3; k++) {
            box[k] = (float)low[k];
            box[3 + k] = (float)((high[k] - (double)box[k]) / 65535);
        }
        for (int k = 0; k < 6; k++)
            boxes = put_float(boxes, box[k]);
        for (uint32_t i = first; i < end; i++)
            for (int k = 0; k < 3; k++) {
                const double off = s->origin[k] + (double)s->centre[c->which[i]][k] - (double)box[k];
                const uint32_t v = step_of(off / fmax((double)box[3 + k], 1e-30), 65535);
                *centres++ = (uint8_t)v;
                *centres++ = (uint8_t)(v >> 8);
            }
    }
}

static uint8_t *put_scales(const chunk *c, uint8_t *at)
{
    for (uint32_t i = 0; i < c->n; i++)
        for (int k = 0; k < 3; k++)
            *at++ = (uint8_t)step_of((double)(log_of(c, i, k) - c->log_low) / fmax((double)c->log_step, 1e-30), 255);
    return at;
}

static uint8_t *put_colours(const chunk *c, uint8_t *at)
{
    const cn_splats *s = c->p->splats;
    for (uint32_t i = 0; i < c->n; i++)
        *at++ = (uint8_t)step_of((double)s->opacity[c->which[i]] * 255, 255);
    for (uint32_t l = 0; l < c->p->n_lights; l++)
        for (uint32_t i = 0; i < c->n; i++, at += 3)
            memcpy(at, c->p->lights[l][c->which[i]], 3);
    if (!c->p->degree) return at;
    const size_t row = (size_t)(s->degree + 1) * (s->degree + 1) * 3;
    for (uint32_t i = 0; i < c->n; i++)
        for (size_t k = 3; k < 12; k++) {
            const double share = (double)s->colour[c->which[i] * row + k] / fmax((double)c->p->harmonics, 1e-30);
            *at++ = (uint8_t)(int8_t)lround(fmin(fmax(share, -1), 1) * 127);
        }
    return at;
}

float cn_packing_harmonics(const cn_splats *s)
{
    const size_t row = (size_t)(s->degree + 1) * (s->degree + 1) * 3;
    float most = 0;
    for (size_t i = 0; i < s->n && s->degree; i++)
        for (size_t k = 3; k < 12; k++)
            most = fmaxf(most, fabsf(s->colour[i * row + k]));
    return most;
}

size_t cn_packed_size(uint32_t n, uint32_t n_lights, uint32_t degree)
{
    const size_t blocks = (n + (size_t)CN_PACKED_BLOCK - 1) / CN_PACKED_BLOCK;
    return CN_PACKED_HEADER + 24 * blocks + (size_t)n * (4 + 6 + 3 + 1 + 3 * (size_t)n_lights + (degree ? 9 : 0));
}

cn_status cn_packed_make(const cn_packing *packing, uint32_t *which, uint32_t n, uint8_t **bytes)
{
    *bytes = NULL;
    if (!n) return cn_fail(CN_ERR_DATA, "a chunk needs a splat");
    chunk c = { .p = packing, .which = which, .n = n };
    CN_TRY(sort_by_place(packing->splats, which, n));
    uint8_t *at = *bytes = malloc(cn_packed_size(n, packing->n_lights, packing->degree));
    if (!at) return cn_fail(CN_ERR_NOMEM, "out of memory for a chunk of %u splats", n);
    measure_scales(&c);
    uint8_t *boxes = put_header(&c, at);
    at = boxes + 24 * ((n + (size_t)CN_PACKED_BLOCK - 1) / CN_PACKED_BLOCK);
    for (uint32_t i = 0; i < n; i++)
        at = put_u32(at, pack_rotation(packing->splats->rotation[which[i]]));
    put_places(&c, boxes, at);
    put_colours(&c, put_scales(&c, at + 6 * (size_t)n));
    return CN_OK;
}
