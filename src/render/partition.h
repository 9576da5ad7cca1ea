/* The tiles' shares of a place, by its horizontal position: a partition of unity over the tiles of a union. */
#ifndef CONURB_RENDER_PARTITION_H
#define CONURB_RENDER_PARTITION_H
#include "conurb/render.h"

/* A tile's place relative to the camera, in metres; as in cn_union_part. */
typedef struct cn_partition_tile {
    float x, y, blend_width, offset;
} cn_partition_tile;
typedef struct cn_partition {
    cn_partition_tile tile[CN_UNION_MAX];
    uint32_t n;
} cn_partition;

/* origin_m: of the places that are asked for later. */
void cn_partition_init(cn_partition *partition, uint32_t n, const cn_union_part *parts, const double origin_m[2]);
/* The tiles' parts of a place relative to the origin; their sum is 1. */
void cn_partition_shares(const cn_partition *partition, float x, float y, float *share);

/* A ray on the map, from the origin on: x and y of its direction, and their length. */
typedef struct cn_map_ray {
    float x, y, length;
} cn_map_ray;
/* Lists the tiles that have a part of the ray between t0 and *t1, and returns how many. *t1: the end that is asked for;
 * it is set to where the answer ends. */
uint32_t cn_partition_active(const cn_partition *partition, const cn_map_ray *ray, float t0, float *t1,
                             uint32_t active[CN_UNION_MAX]);
#endif
