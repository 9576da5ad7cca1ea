/* Reads the places and triangles of a PLY file (Turk 1994): ASCII or binary little-endian. */
#ifndef CONURB_SURFACE_PLY_H
#define CONURB_SURFACE_PLY_H
#include "conurb/base.h"

typedef struct cn_triangle_list {
    float (*places)[3];
    uint32_t (*corners)[3];
    uint32_t n_places, n_triangles; /* no triangles: points */
} cn_triangle_list;
/* Faces with more than three corners become fans. CN_ERR_FORMAT: the message names the file and what is wrong. */
CN_NODISCARD cn_status cn_ply_read(cn_triangle_list *list, const char *path);
void cn_triangle_list_deinit(cn_triangle_list *list); /* fine when zeroed */
#endif
