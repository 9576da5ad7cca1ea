/* Where a camera can fly: space between the photos that their lines of sight to sparse points show to be empty (space
 * carving). Walls have points, and no line of sight passes through a house. */
#ifndef CONURB_PATH_FREE_SPACE_H
#define CONURB_PATH_FREE_SPACE_H
#include "conurb/pose.h"

typedef struct cn_free_space {
    uint32_t n[3];          /* cells along x, y, z; all 0: nothing is known, and every straight line is free */
    double origin[3], edge; /* metres: the lowest corner of cell 0, and a cell's edge */
    uint8_t *cost;          /* [n[2]][n[1]][n[0]] a metre's cost: 1 in free space */
} cn_free_space;

/* The box of the views' centres. Without points, or where all views share a place, it has no cells. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_free_space_carve(cn_free_space *space, const cn_scene *scene);
void cn_free_space_deinit(cn_free_space *space);
/* The cost of the straight line: its length in metres when all of it is free. */
double cn_free_space_line(const cn_free_space *space, const double from[3], const double to[3]);
/* The corners of a route from one place to another that costs much less than the straight line, without its two ends;
 * none where there is none. A* (Hart et al. 1968). The caller frees *corners. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_free_space_route(const cn_free_space *space, const double from[3], const double to[3],
                                           double (**corners)[3], size_t *n);
#endif
