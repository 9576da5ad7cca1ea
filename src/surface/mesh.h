/* A mesh in memory. */
#ifndef CONURB_SURFACE_MESH_H
#define CONURB_SURFACE_MESH_H
#include "surface/triangles.h"

typedef struct cn_mesh {
    cn_surface_vertex *vertices;
    uint32_t *corners; /* 3 of each triangle */
    uint32_t n_vertices, n_triangles;
} cn_mesh;
void cn_mesh_deinit(cn_mesh *mesh); /* fine when zeroed */
/* Reads the vertices that number[] keeps, and their triangles; n: how many of each. CN_ERR_USAGE: more than memory can
 * number. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_mesh_read(cn_mesh *mesh, cn_triangles *triangles, const uint32_t *number,
                                    const uint64_t n[2]);
/* What of a simplification is wanted. */
typedef struct cn_mesh_wish {
    uint64_t triangles; /* as few as this, when most_m allows */
    double most_m;      /* the surface may move by so much in a pass; INFINITY: by anything */
    double least_m;     /* with cells: what it may move by at first; the limit doubles while there are too many */
    double cell_m; /* side of the squares of the map that are simplified one after another; INFINITY: all at once */
} cn_mesh_wish;
/* Removes triangles (quadric error; Garland and Heckbert 1997, by meshoptimizer). Vertices are not moved, and those at
 * the mesh's border stay. With cells there are pairs of passes, the second with cells that are half a cell off, so that
 * the borders of the first are simplified too; no crack opens between cells. *error_m: how far the surface moved at
 * most. Memory: 60 bytes for each triangle of a cell. CN_ERR_NOMEM, CN_ERR_INTERRUPTED. */
CN_NODISCARD cn_status cn_mesh_simplify(const cn_context *ctx, cn_mesh *mesh, const cn_mesh_wish *wish,
                                        double *error_m);
/* Unit normal of a triangle, counterclockwise seen from the front; returns its area. */
double cn_mesh_normal(const cn_mesh *mesh, uint32_t triangle, double normal[3]);
#endif
