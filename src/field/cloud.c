#include "field/cloud.h"

#include "kernel/kernel.h"

#include <math.h>
#include <string.h>

enum { CELLS = 8 }; /* about a place */

size_t cn_cloud_value_entries(const cn_cloud *c)
{
    return (size_t)c->n_levels * cn_cloud_slots(c) * CN_CLOUD_PAIRS;
}
size_t cn_cloud_place_entries(const cn_cloud *c)
{
    return (size_t)c->n_levels * cn_cloud_slots(c) * 3;
}

/* First entry of a bucket's places. */
static size_t places_of(const cn_cloud *c, uint32_t level, uint32_t bucket)
{
    return cn_cloud_value_entries(c) + ((size_t)level * c->buckets + bucket) * 3 * CN_CLOUD_BUCKET;
}

/* Bucket of a cell. x, y, z: from 0, where 0 is outside on the low side, to cells + 1. */
static uint32_t bucket_of(const cn_cloud *c, uint32_t level, uint32_t x, uint32_t y, uint32_t z)
{
    const uint32_t side = c->cells[level] + 2;
    if ((uint64_t)side * side * side <= c->buckets) return x + side * (y + side * z);
    return (x ^ y * 2654435761u ^ z * 805459861u) & (c->buckets - 1);
}

static uint32_t own_bucket(const cn_cloud *c, uint32_t level, const float x[3])
{
    uint32_t cell[3];
    for (int a = 0; a < 3; a++)
        cell[a] = (uint32_t)(fminf(fmaxf(x[a], 0), 1) * (float)c->cells[level]) + 1;
    return bucket_of(c, level, cell[0], cell[1], cell[2]);
}

/* The buckets of the eight cells about a place, each once. */
static uint32_t buckets_about(const cn_cloud *c, uint32_t level, const float x[3], uint32_t bucket[CELLS])
{
    uint32_t first[3], n = 0;
    for (int a = 0; a < 3; a++)
        first[a] = (uint32_t)(fminf(fmaxf(x[a], 0), 1) * (float)c->cells[level] + 0.5f);
    for (uint32_t i = 0; i < CELLS; i++) {
        const uint32_t b = bucket_of(c, level, first[0] + (i & 1), first[1] + ((i >> 1) & 1), first[2] + (i >> 2));
        bool seen = false;
        for (uint32_t j = 0; j < n; j++)
            seen = seen || bucket[j] == b;
        if (!seen) bucket[n++] = b;
    }
    return n;
}

/* A coordinate of all points of a bucket. */
typedef float floats __attribute__((vector_size(4 * CN_CLOUD_BUCKET)));
typedef uint32_t words __attribute__((vector_size(4 * CN_CLOUD_BUCKET)));

static inline void coordinates(const uint32_t *place, floats *x)
{
    words pair;
    memcpy(&pair, place, sizeof pair);
    *x = (floats)(pair << 16) + (floats)(pair & 0xffff0000u);
}

static void keep_nearest(const cn_cloud *c, cn_cloud_near *near, uint32_t slot, const float offset[3], float square)
{
    uint32_t at = near->n;
    while (at > 0 && square < near->square[at - 1])
        at--;
    if (at >= c->neighbours) return;
    const uint32_t n = near->n < c->neighbours ? near->n++ : near->n - 1;
    for (uint32_t i = n; i > at; i--) {
        near->slot[i] = near->slot[i - 1];
        near->square[i] = near->square[i - 1];
        memcpy(near->offset[i], near->offset[i - 1], sizeof near->offset[i]);
    }
    near->slot[at] = slot;
    near->square[at] = square;
    memcpy(near->offset[at], offset, sizeof near->offset[at]);
}

void cn_cloud_find(const cn_cloud *c, const uint32_t *table, uint32_t level, const float x[3], cn_cloud_near *near)
{
    const float scale = 2 * (float)c->cells[level];
    uint32_t bucket[CELLS];
    const uint32_t n = buckets_about(c, level, x, bucket);
    near->n = 0;
    for (uint32_t b = 0; b < n; b++)
        __builtin_prefetch(table + places_of(c, level, bucket[b]));
    for (uint32_t b = 0; b < n; b++) {
        const uint32_t *place = table + places_of(c, level, bucket[b]);
        floats d[3], square = { 0 };
        for (int a = 0; a < 3; a++) {
            coordinates(place + a * CN_CLOUD_BUCKET, &d[a]);
            d[a] = (x[a] - d[a]) * scale;
            square += d[a] * d[a];
        }
        for (uint32_t i = 0; i < CN_CLOUD_BUCKET; i++)
            if (square[i] < 1)
                keep_nearest(c, near, bucket[b] * CN_CLOUD_BUCKET + i, (float[3]){ d[0][i], d[1][i], d[2][i] },
                             square[i]);
    }
}

static float read_pair(uint32_t pair)
{
    return cn_bf16_to_float((uint16_t)pair) + cn_bf16_to_float((uint16_t)(pair >> 16));
}

static uint32_t write_pair(float x)
{
    const uint16_t high = cn_bf16_from_float(x);
    return (uint32_t)high << 16 | cn_bf16_from_float(x - cn_bf16_to_float(high));
}

bool cn_cloud_point(const cn_cloud *c, const uint32_t *table, uint32_t level, uint32_t slot, float x[3])
{
    const uint32_t *place = table + places_of(c, level, slot / CN_CLOUD_BUCKET) + slot % CN_CLOUD_BUCKET;
    for (int a = 0; a < 3; a++)
        x[a] = read_pair(place[a * CN_CLOUD_BUCKET]);
    return x[0] > 0.5f * CN_CLOUD_NOWHERE;
}

bool cn_cloud_insert(const cn_cloud *c, uint32_t *table, uint32_t level, const float x[3], float apart, uint32_t *slot)
{
    const uint32_t bucket = own_bucket(c, level, x);
    cn_cloud_near near;
    float there[3];
    uint32_t i = 0;
    while (i < CN_CLOUD_BUCKET && cn_cloud_point(c, table, level, bucket * CN_CLOUD_BUCKET + i, there))
        i++;
    if (i == CN_CLOUD_BUCKET) return false;
    cn_cloud_find(c, table, level, x, &near);
    if (near.n && near.square[0] < apart * apart) return false;
    *slot = bucket * CN_CLOUD_BUCKET + i;
    for (size_t a = 0; a < 3; a++)
        table[places_of(c, level, bucket) + a * CN_CLOUD_BUCKET + i] = write_pair(x[a]);
    return true;
}

void cn_cloud_remove(const cn_cloud *c, uint32_t *table, uint32_t level, uint32_t slot)
{
    table[places_of(c, level, slot / CN_CLOUD_BUCKET) + slot % CN_CLOUD_BUCKET] = write_pair(CN_CLOUD_NOWHERE);
}
