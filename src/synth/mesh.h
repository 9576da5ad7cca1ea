/* The geometry of a synthetic city: patches (parallelograms and triangles) on charts (light maps). */
#ifndef CONURB_SYNTH_MESH_H
#define CONURB_SYNTH_MESH_H
#include "conurb/base.h"

typedef enum cn_material {
    CN_MAT_WALL,   /* of a building: brick, plaster, stone or concrete as the seed says */
    CN_MAT_REVEAL, /* the sides of window openings, sills, cornices */
    CN_MAT_WINDOW,
    CN_MAT_SHOP,
    CN_MAT_SIGN,
    CN_MAT_DOOR,
    CN_MAT_AWNING,
    CN_MAT_FLAT_ROOF,
    CN_MAT_TILES,
    CN_MAT_ROAD,
    CN_MAT_PAVING,
    CN_MAT_KERB,
    CN_MAT_LAWN,
    CN_MAT_BARK,
    CN_MAT_LEAF,
    CN_MAT_METAL,
    CN_MAT_WOOD,
    CN_MAT_LAMP,
    CN_MAT_PAINT, /* cars */
    CN_MAT_CAR_GLASS,
    CN_MAT_TYRE,
    CN_MAT_CLOTH,
    CN_MAT_SKIN
} cn_material;

/* A rectangle with a light map and metric texture coordinates: s along u, t along v, from the corner. Patches in its
 * plane share it, so that light and texture are continuous across them. */
typedef struct cn_chart {
    float corner[3], u[3], v[3], normal[3]; /* u, v, normal: unit length */
    float width_m, height_m;
    uint32_t nu, nv, first; /* light-map texels */
    uint32_t seed;          /* of what it belongs to: a building, a tree */
} cn_chart;

typedef struct cn_patch {
    float corner[3], u[3], v[3]; /* corner + a u + b v, a and b in [0, 1]; triangles: a + b <= 1 */
    float normal[3];             /* unit; for leaves that of the crown */
    uint32_t chart;
    uint32_t id; /* distinguishes windows and leaves */
    uint8_t material;
    bool triangle;
} cn_patch;

typedef struct cn_mesh {
    cn_patch *patches;
    uint32_t n_patches, room_patches;
    cn_chart *charts;
    uint32_t n_charts, room_charts;
    uint32_t n_texels;
    bool full; /* out of memory: nothing was added since */
    /* The pen: properties of new patches. */
    uint32_t chart, seed, id;
    cn_material material;
    float texel_m;
    bool keep_chart; /* what makes charts of its own stays on the pen's: for small things, which need none */
} cn_mesh;

void cn_mesh_deinit(cn_mesh *mesh);
/* A chart spanned by u and v (metres, at right angles), with texels of about mesh->texel_m; becomes the pen's. */
void cn_mesh_chart(cn_mesh *mesh, const float corner[3], const float u[3], const float v[3]);
/* Patches on the pen's chart, with the pen's material and id. The normal is u x v. */
void cn_mesh_patch(cn_mesh *mesh, const float corner[3], const float u[3], const float v[3]);
void cn_mesh_triangle(cn_mesh *mesh, const float corner[3], const float u[3], const float v[3]);
/* A chart and one patch that covers it. */
void cn_mesh_panel(cn_mesh *mesh, const float corner[3], const float u[3], const float v[3]);
/* The five faces that show of a box: axes u, v, w at right angles and right-handed, from a corner; all but the one
 * spanned by u and v at the corner. */
void cn_mesh_box(cn_mesh *mesh, const float corner[3], const float u[3], const float v[3], const float w[3]);
/* Upright box of the city's axes turned by `turn` (radians) about its centre (x, y, z: middle of its floor). */
void cn_mesh_block(cn_mesh *mesh, const float centre[3], const float size[3], float turn);
/* Upright prism of n sides, radius r0 at the bottom and r1 at the top, with a lid. */
void cn_mesh_prism(cn_mesh *mesh, const float bottom[3], float height, float r0, float r1, int n);
#endif
