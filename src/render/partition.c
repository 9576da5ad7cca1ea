#include "render/partition.h"

#include <math.h>

#define SPAN 2.0f /* the longest range of one answer: its end divided by its beginning */

/* Unlike fminf and fmaxf these do not handle NaN, so they need no function call. */
static inline float lesser(float a, float b)
{
    return a < b ? a : b;
}
static inline float greater(float a, float b)
{
    return a > b ? a : b;
}

void cn_partition_init(cn_partition *p, uint32_t n, const cn_union_part *parts, const double origin_m[2])
{
    p->n = n;
    for (uint32_t i = 0; i < n; i++)
        p->tile[i] = (cn_partition_tile){ .x = (float)(parts[i].centre_m[0] - origin_m[0]),
                                          .y = (float)(parts[i].centre_m[1] - origin_m[1]),
                                          .blend_width = (float)parts[i].blend_width_m,
                                          .offset = (float)parts[i].offset_m };
}

/* The distance of a place to each tile's centre, with the tile's offset. Returns the smallest. */
static float distances(const cn_partition *p, float x, float y, float *d)
{
    float least = INFINITY;
    for (uint32_t i = 0; i < p->n; i++) {
        const float dx = x - p->tile[i].x, dy = y - p->tile[i].y;
        d[i] = sqrtf(dx * dx + dy * dy) + p->tile[i].offset;
        least = lesser(least, d[i]);
    }
    return least;
}

void cn_partition_shares(const cn_partition *p, float x, float y, float *share)
{
    if (p->n == 1) {
        share[0] = 1;
        return;
    }
    const float least = distances(p, x, y, share);
    float sum = 0;
    for (uint32_t i = 0; i < p->n; i++) {
        const float g = greater(1 - (share[i] - least) / p->tile[i].blend_width, 0);
        share[i] = g * g;
        sum += share[i];
    }
    for (uint32_t i = 0; i < p->n; i++)
        share[i] /= sum;
}

static uint32_t nearest(const cn_partition *p, const float *d)
{
    uint32_t first = 0;
    for (uint32_t i = 1; i < p->n; i++)
        if (d[i] < d[first]) first = i;
    return first;
}

/* Along the ray a distance changes by at most what the ray moves on the map, and the difference of two distances by at
 * most twice that. So where one tile leads, the range goes on for as long as the lead lasts. In a short range between
 * two places of the same tile, another tile counts only if it has a part at one of the ends. Between the ends it could
 * have less than a thousandth. */
uint32_t cn_partition_active(const cn_partition *p, const cn_map_ray *ray, float t0, float *t1,
                             uint32_t active[CN_UNION_MAX])
{
    float d[CN_UNION_MAX], e[CN_UNION_MAX], lead = INFINITY;
    uint32_t n = 0;
    active[0] = 0;
    if (p->n == 1) return 1;
    const float end = *t1, least = distances(p, t0 * ray->x, t0 * ray->y, d);
    const uint32_t first = active[0] = nearest(p, d);
    for (uint32_t i = 0; i < p->n; i++)
        if (i != first) lead = lesser(lead, d[i] - least - p->tile[i].blend_width);
    *t1 = lesser(t0 * SPAN, end);
    if (lead > 2 * (*t1 - t0) * ray->length) {
        *t1 = lesser(t0 + lead / greater(2 * ray->length, 1e-9f), end);
        return 1;
    }
    const float there = distances(p, *t1 * ray->x, *t1 * ray->y, e);
    const float slack = nearest(p, e) == first ? 0 : 2 * (*t1 - t0) * ray->length;
    for (uint32_t i = 0; i < p->n; i++)
        if (lesser(d[i] - least, e[i] - there) < p->tile[i].blend_width + slack) active[n++] = i;
    return n;
}
