#include "surface/nets.h"

#include "math/linalg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SIDE = CN_LATTICE_SIDE, NONE = -1 };

void cn_nets_deinit(cn_nets *nets)
{
    cn_keys_deinit(&nets->border);
    free(nets->vertices);
    *nets = (cn_nets){ 0 };
}

/* A lattice point: its block's slot and its place in it. slot NONE: the block is not there. */
typedef struct place {
    int64_t slot;
    int point;
} place;

/* The point at a block's corner plus `in`, -1 to 8 on each axis. */
static place place_at(const cn_fusion *f, const cn_fusion_block *b, const int32_t in[3])
{
    int32_t block[3], inner[3];
    bool here = true;
    for (int k = 0; k < 3; k++) {
        const int32_t off = in[k] < 0 ? -1 : in[k] >= SIDE;
        block[k] = b->at[k] + off;
        inner[k] = in[k] - off * SIDE;
        here = here && off == 0;
    }
    const int point = inner[0] + SIDE * (inner[1] + SIDE * inner[2]);
    if (here) return (place){ b - f->blocks, point };
    const uint32_t slot = cn_keys_find(&f->slots, cn_lattice_key(block));
    return (place){ slot == UINT32_MAX ? NONE : (int64_t)slot, point };
}

/* The distances at a cube's corners. False when one is unknown, or no corner was seen often enough. */
static bool corners_of(const cn_fusion *f, const cn_fusion_block *b, const int32_t in[3], uint8_t least,
                       float distance[8])
{
    uint8_t most = 0;
    for (int c = 0; c < 8; c++) {
        const int32_t at[3] = { in[0] + (c & 1), in[1] + (c >> 1 & 1), in[2] + (c >> 2) };
        const place p = place_at(f, b, at);
        if (p.slot == NONE || !(f->blocks[p.slot].weight[p.point] > 0)) return false;
        distance[c] = f->blocks[p.slot].distance[p.point];
        if (f->blocks[p.slot].seen[p.point] > most) most = f->blocks[p.slot].seen[p.point];
    }
    return most >= least;
}

/* A surface through a point of the lattice would give all cubes around it a vertex at that point, and triangles without
 * an area. So no crossing is nearer to the end of an edge than this part of it. */
#define END 0.02

/* The mean of the places where the surface crosses the cube's edges, and the gradient. False: it does not. */
static bool vertex_in(const float d[8], double in_cube[3], double normal[3])
{
    int n = 0;
    memset(in_cube, 0, 3 * sizeof *in_cube);
    memset(normal, 0, 3 * sizeof *normal);
    for (int axis = 0; axis < 3; axis++)
        for (int c = 0; c < 8; c++) {
            const int other = c | 1 << axis;
            if (c == other) continue;
            normal[axis] += (double)(d[other] - d[c]);
            if ((d[c] > 0) == (d[other] > 0)) continue;
            const double at = (double)d[c] / ((double)d[c] - (double)d[other]);
            const double part = fmin(fmax(at, END), 1.0 - END);
            for (int k = 0; k < 3; k++)
                in_cube[k] += k == axis ? part : c >> k & 1;
            n++;
        }
    for (int k = 0; k < 3 && n; k++)
        in_cube[k] /= n;
    return n > 0;
}

static cn_status find_in_block(cn_nets *nets, cn_fusion *f, cn_fusion_block *b)
{
    for (int i = 0; i < CN_LATTICE_POINTS; i++) {
        const int32_t in[3] = { i % SIDE, i / SIDE % SIDE, i / (SIDE * SIDE) };
        float d[8];
        double in_cube[3], normal[3];
        if (!corners_of(f, b, in, nets->least_seen, d) || !vertex_in(d, in_cube, normal)) continue;
        if (!cn_normalize3(normal)) normal[2] = 1;
        if (nets->n == nets->room) {
            const uint32_t room = nets->room ? 2 * nets->room : 4096;
            cn_surface_vertex *vertices = realloc(nets->vertices, room * sizeof *vertices);
            if (!vertices) return cn_fail(CN_ERR_NOMEM, "out of memory for %u vertices; give a larger --gsd", room);
            nets->vertices = vertices;
            nets->room = room;
        }
        cn_surface_vertex *v = &nets->vertices[nets->n];
        *v = (cn_surface_vertex){ 0 };
        for (int k = 0; k < 3; k++) {
            v->xyz[k] = (float)(f->cube_m * (b->at[k] * SIDE + in[k] + in_cube[k]));
            v->normal[k] = (float)normal[k];
        }
        b->vertex[i] = nets->n++;
    }
    return CN_OK;
}

cn_status cn_nets_find(cn_nets *nets, cn_fusion *f)
{
    nets->n = 0;
    for (uint32_t i = 0; i < f->n; i++)
        if (f->blocks[i].own) CN_TRY(find_in_block(nets, f, &f->blocks[i]));
    return CN_OK;
}

static uint64_t cube_key(const cn_fusion_block *b, const int32_t in[3])
{
    const int32_t at[3] = { b->at[0] * SIDE + in[0], b->at[1] * SIDE + in[1], b->at[2] * SIDE + in[2] };
    return cn_lattice_key(at);
}

/* The vertex of a cube, of this region or of an earlier one; UINT32_MAX: none. */
static uint32_t vertex_at(const cn_nets *nets, const cn_fusion *f, const cn_fusion_block *b, const int32_t in[3])
{
    const place p = place_at(f, b, in);
    if (p.slot != NONE && f->blocks[p.slot].own) return f->blocks[p.slot].vertex[p.point];
    return cn_keys_find(&nets->border, cube_key(b, in));
}

/* The two triangles across the edge from a point along an axis. */
static cn_status add_across(cn_nets *nets, const cn_fusion *f, const cn_fusion_block *b, int i, int axis)
{
    int32_t in[3] = { i % SIDE, i / SIDE % SIDE, i / (SIDE * SIDE) };
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    const float here = b->distance[i];
    uint32_t around[4];
    in[axis]++;
    const place end = place_at(f, b, in);
    in[axis]--;
    if (end.slot == NONE || !(f->blocks[end.slot].weight[end.point] > 0)) return CN_OK;
    if ((here > 0) == (f->blocks[end.slot].distance[end.point] > 0)) return CN_OK;
    for (int c = 0; c < 4; c++) {
        int32_t at[3] = { in[0], in[1], in[2] };
        at[u] -= c == 1 || c == 2;
        at[v] -= c >= 2;
        around[c] = vertex_at(nets, f, b, at);
        if (around[c] == UINT32_MAX) return CN_OK;
    }
    /* Corners run counterclockwise when seen from the front, where the distance is positive. */
    const int second = here > 0 ? 3 : 1, fourth = here > 0 ? 1 : 3;
    const uint32_t a[3] = { around[0], around[second], around[2] }, z[3] = { around[0], around[2], around[fourth] };
    CN_TRY(cn_triangles_add(nets->triangles, a));
    return cn_triangles_add(nets->triangles, z);
}

/* Numbers vertices as the file does, and keeps those that later regions need. */
static cn_status number_vertices(cn_nets *nets, cn_fusion *f)
{
    const uint32_t first = nets->triangles->n_vertices;
    CN_TRY(cn_triangles_add_vertices(nets->triangles, nets->vertices, nets->n));
    for (uint32_t n = 0; n < f->n; n++) {
        cn_fusion_block *b = &f->blocks[n];
        const bool last[2] = {
            cn_lattice_down(b->at[0] + 1, CN_LATTICE_REGION) != cn_lattice_down(b->at[0], CN_LATTICE_REGION),
            cn_lattice_down(b->at[1] + 1, CN_LATTICE_REGION) != cn_lattice_down(b->at[1], CN_LATTICE_REGION)
        };
        for (int i = 0; b->own && i < CN_LATTICE_POINTS; i++) {
            const int32_t in[3] = { i % SIDE, i / SIDE % SIDE, i / (SIDE * SIDE) };
            bool fresh;
            if (b->vertex[i] == UINT32_MAX) continue;
            b->vertex[i] += first;
            if ((last[0] && in[0] == SIDE - 1) || (last[1] && in[1] == SIDE - 1))
                CN_TRY(cn_keys_add(&nets->border, cube_key(b, in), b->vertex[i], &fresh));
        }
    }
    return CN_OK;
}

cn_status cn_nets_add(cn_nets *nets, cn_fusion *f)
{
    CN_TRY(number_vertices(nets, f));
    for (uint32_t n = 0; n < f->n; n++) {
        const cn_fusion_block *b = &f->blocks[n];
        for (int i = 0; b->own && i < CN_LATTICE_POINTS; i++)
            for (int axis = 0; axis < 3 && b->weight[i] > 0; axis++)
                CN_TRY(add_across(nets, f, b, i, axis));
    }
    return CN_OK;
}
