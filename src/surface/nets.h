/* Surface nets: one vertex in each cube that the surface passes, one quadrilateral across each edge. */
#ifndef CONURB_SURFACE_NETS_H
#define CONURB_SURFACE_NETS_H
#include "surface/fusion.h"
#include "surface/triangles.h"

typedef struct cn_nets {
    cn_triangles *triangles;
    uint8_t least_seen; /* a cube has a vertex when one of its corners was seen by so many maps */
    /* Vertices of cubes at the borders of the regions so far, by the cube's key, for the regions that come after. */
    cn_keys border;
    cn_surface_vertex *vertices; /* of the region */
    uint32_t n, room;
} cn_nets;
void cn_nets_deinit(cn_nets *nets);
/* Finds the region's vertices: places and normals, without colours. */
CN_NODISCARD cn_status cn_nets_find(cn_nets *nets, cn_fusion *fusion);
/* Adds the region's vertices, with their colours, and its triangles. Regions come in order: y, then x. */
CN_NODISCARD cn_status cn_nets_add(cn_nets *nets, cn_fusion *fusion);
#endif
