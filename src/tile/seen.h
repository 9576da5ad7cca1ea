/* What the trained photos saw of a tile's surroundings. A ray that meets no matter shows the sky. But a wall that no
 * photo saw is missing in the field, and a ray meets nothing there either. So the tile keeps which places photos saw,
 * and how often and how far away they show matter in a direction. */
#ifndef CONURB_TILE_SEEN_H
#define CONURB_TILE_SEEN_H
#include "kernel/kernel.h"

enum {
    CN_SEEN_RES = 64, /* places along an axis of contracted space */
    CN_SEEN_PLACES = CN_SEEN_RES * CN_SEEN_RES * CN_SEEN_RES,
    CN_SEEN_AROUND = 64, /* directions: azimuths, and rows of equal steps of the sine of the elevation */
    CN_SEEN_UP = 32,
    CN_SEEN_DIRECTIONS = CN_SEEN_AROUND * CN_SEEN_UP
};
#define CN_SEEN_LOWEST -0.15f /* sine of the elevation of the lowest row's lower edge; the last row ends at 1 */

typedef struct cn_seen {
    const uint32_t *places; /* [CN_SEEN_PLACES / 32] bits, x fastest, lowest first: a trained photo sees the place,
                             * or it is above nearly all sparse points */
    const uint8_t *matter;  /* [CN_SEEN_UP][CN_SEEN_AROUND] share of 255 of the photos that look there and show matter,
                             * of those that show matter or sky; 0 where no photo tells */
    const float *distance;  /* the same cells: how far away matter is in this direction, from a photo: the median, in
                             * metres; 0 where no photo tells */
    const float *reach;     /* the same cells: how far along this direction matter is, from the box's centre: the
                             * median, in metres; -INFINITY where its distance from the photos varies less. NULL: the
                             * file is of an earlier version */
} cn_seen;

/* The unit direction in the middle of a cell. */
void cn_seen_direction(uint32_t cell, float dir[3]);
/* Of a ray that meets no matter: how sure it is that there is none, 0 to 1. ray: box units a metre; dir: unit. */
float cn_seen_open(const cn_seen *seen, const cn_box_ray *ray, const float dir[3]);
#endif
