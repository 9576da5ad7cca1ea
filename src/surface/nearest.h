/* Distance to the nearest of many triangles or points, by a tree of boxes. */
#ifndef CONURB_SURFACE_NEAREST_H
#define CONURB_SURFACE_NEAREST_H
#include "surface/ply.h"

typedef struct cn_nearest_node cn_nearest_node;
typedef struct cn_nearest {
    const cn_triangle_list *list; /* borrowed */
    uint32_t n;                   /* triangles, or places when there are none */
    uint32_t *order;
    cn_nearest_node *nodes;
} cn_nearest;
/* The list has a place. CN_ERR_NOMEM. Takes O(n log n). */
CN_NODISCARD cn_status cn_nearest_init(cn_nearest *nearest, const cn_triangle_list *list);
void cn_nearest_deinit(cn_nearest *nearest); /* fine when zeroed */
/* Any thread. */
double cn_nearest_distance(const cn_nearest *nearest, const float place[3]);
#endif
