/* A k-d tree of places in a plane (Bentley 1975, "Multidimensional binary search trees"). A query takes O(log n) for
 * each place found, also when all places lie on a line or at one point. */
#ifndef CONURB_MATH_PLANE_H
#define CONURB_MATH_PLANE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct cn_plane_node cn_plane_node;
typedef struct cn_plane {
    const double (*places)[2]; /* the caller's; finite */
    const double *radii;       /* the caller's; NULL: all 0 */
    uint32_t n;
    uint32_t *order;
    cn_plane_node *nodes;
    uint64_t n_compared; /* places that queries have looked at so far */
} cn_plane;
/* False when out of memory. Building takes O(n log n). */
bool cn_plane_init(cn_plane *plane, const double (*places)[2], const double *radii, uint32_t n);
void cn_plane_deinit(cn_plane *plane);

typedef struct cn_plane_found {
    double square; /* of the distance */
    uint32_t index;
} cn_plane_found;
/* Finds up to k places nearest to places[self], without itself, nearest first; returns their number. At equal
 * distance, places before self in the list come first, by falling index, then those after it. One thread per plane at
 * a time. */
uint32_t cn_plane_neighbours(cn_plane *plane, uint32_t self, uint32_t k, cn_plane_found *found);
/* The place nearest to `place`; at equal distance the first in the list. n must not be 0. */
uint32_t cn_plane_nearest(cn_plane *plane, const double place[2]);
/* Calls visit for each circle that overlaps circle self and comes after it in the list, in no order. False as soon as
 * visit returns false. */
bool cn_plane_overlaps(cn_plane *plane, uint32_t self, bool (*visit)(void *user, uint32_t index), void *user);
#endif
