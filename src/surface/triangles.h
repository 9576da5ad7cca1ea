/* Vertices and triangles as they are found, in scratch files, and the pieces that they form. */
#ifndef CONURB_SURFACE_TRIANGLES_H
#define CONURB_SURFACE_TRIANGLES_H
#include "conurb/base.h"

#include <stdio.h>

typedef struct cn_surface_vertex {
    float xyz[3], normal[3]; /* local metres; unit length */
    uint8_t rgb[4];          /* display-encoded; the fourth is unused */
    float eye[3];            /* a place from where the photos see it: their mean direction and distance */
} cn_surface_vertex;
typedef struct cn_triangles {
    const char *path;
    FILE *vertices, *corners; /* cn_surface_vertex; three uint32_t for a triangle */
    uint32_t n_vertices, room;
    uint64_t n_triangles;
    uint32_t *parent; /* of each vertex: a forest of pieces (union-find) */
} cn_triangles;
/* Scratch files are made in the folder of path, which is borrowed. */
CN_NODISCARD cn_status cn_triangles_open(cn_triangles *triangles, const char *path);
void cn_triangles_close(cn_triangles *triangles); /* fine when zeroed */
CN_NODISCARD cn_status cn_triangles_add_vertices(cn_triangles *triangles, const cn_surface_vertex *vertices,
                                                 uint32_t n);
CN_NODISCARD cn_status cn_triangles_add(cn_triangles *triangles, const uint32_t corner[3]);
/* Gives each vertex of a piece with `least` triangles or more its new number, others UINT32_MAX: number[n_vertices],
 * which the caller frees. n_kept: vertices and triangles that stay. The forest is used up. */
CN_NODISCARD cn_status cn_triangles_select(cn_triangles *triangles, uint32_t least, uint32_t **number,
                                           uint64_t n_kept[2]);
/* Reads from the beginning. */
CN_NODISCARD cn_status cn_triangles_rewind(cn_triangles *triangles);
CN_NODISCARD cn_status cn_triangles_next_vertex(cn_triangles *triangles, cn_surface_vertex *vertex);
CN_NODISCARD cn_status cn_triangles_next(cn_triangles *triangles, uint32_t corner[3]);
#endif
