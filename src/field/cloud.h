/* A cloud of points at a few spacings, and the points nearest to a place. Private to field/.
 *
 * A level has cubic cells over contracted space. A point lies in the bucket of its cell; a bucket has room for
 * CN_CLOUD_BUCKET points. The points within half a cell of a place lie in eight cells. When there are fewer buckets
 * than cells, cells share buckets by a hash. The distance tells which points of a bucket are near, so nothing else has
 * to.
 *
 * The table of the field holds, for each level, the values of every slot, CN_CLOUD_PAIRS pairs each; and behind those
 * of all levels, for each level and bucket, its points' x, then y, then z. A coordinate is a pair of bfloat16 whose sum
 * it is: 17 bits. */
#ifndef CONURB_FIELD_CLOUD_H
#define CONURB_FIELD_CLOUD_H
#include "conurb/base.h"

enum { CN_CLOUD_LEVELS = 8, CN_CLOUD_BUCKET = 8, CN_CLOUD_PAIRS = 8, CN_CLOUD_NEAREST = 16 };
#define CN_CLOUD_NOWHERE (-8.0f) /* x of an empty slot */

typedef struct cn_cloud {
    uint32_t n_levels, buckets, cells[CN_CLOUD_LEVELS]; /* buckets of a level, a power of two; cells along an axis */
    uint32_t neighbours;                                /* at most so many points count at a place */
} cn_cloud;

static inline uint32_t cn_cloud_slots(const cn_cloud *cloud)
{
    return cloud->buckets * CN_CLOUD_BUCKET;
}
/* Distance from which a point of a level counts no more, in units of contracted space [0,1]. */
static inline float cn_cloud_radius(const cn_cloud *cloud, uint32_t level)
{
    return 0.5f / (float)cloud->cells[level];
}
/* Entries of the table: of all values, and of all places behind them. */
size_t cn_cloud_value_entries(const cn_cloud *cloud);
size_t cn_cloud_place_entries(const cn_cloud *cloud);

/* The nearest points of a level, nearest first. offset: from the point to the place, over the radius. */
typedef struct cn_cloud_near {
    uint32_t n, slot[CN_CLOUD_NEAREST];
    float offset[CN_CLOUD_NEAREST][3], square[CN_CLOUD_NEAREST]; /* square: of the offset's length, below 1 */
} cn_cloud_near;
void cn_cloud_find(const cn_cloud *cloud, const uint32_t *table, uint32_t level, const float x[3], cn_cloud_near *near);

/* Whether a slot holds a point, and where. */
bool cn_cloud_point(const cn_cloud *cloud, const uint32_t *table, uint32_t level, uint32_t slot, float x[3]);
/* Puts a point into a free slot of its bucket. False: it has none, or a point lies within `apart` radii. */
bool cn_cloud_insert(const cn_cloud *cloud, uint32_t *table, uint32_t level, const float x[3], float apart,
                     uint32_t *slot);
void cn_cloud_remove(const cn_cloud *cloud, uint32_t *table, uint32_t level, uint32_t slot);
#endif
