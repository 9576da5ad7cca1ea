/* The lattice: points at whole multiples of the cube's side, in blocks of 8 x 8 x 8, in regions of 16 x 16 columns of
 * blocks on the map. */
#ifndef CONURB_SURFACE_LATTICE_H
#define CONURB_SURFACE_LATTICE_H
#include "base/keys.h"

enum {
    CN_LATTICE_SIDE = 8, /* points a side of a block */
    CN_LATTICE_POINTS = 512,
    CN_LATTICE_REGION = 16, /* blocks a side of a region */
    CN_LATTICE_BAND = 4     /* cubes on each side of the surface in which the distance is kept */
};
#define CN_LATTICE_MOST 1048000 /* points or blocks from the origin: 21 bits of a key */

static inline uint64_t cn_lattice_key(const int32_t at[3])
{
    uint64_t key = 1;
    for (int k = 0; k < 3; k++)
        key = key << 21 | (uint64_t)(at[k] + 1048576);
    return key;
}
/* Division that rounds down; by > 0. */
static inline int32_t cn_lattice_down(int32_t value, int32_t by)
{
    return value >= 0 ? value / by : -((by - 1 - value) / by);
}
#endif
