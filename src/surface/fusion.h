/* The signed distance of a region of the lattice, fused from depth maps. */
#ifndef CONURB_SURFACE_FUSION_H
#define CONURB_SURFACE_FUSION_H
#include "surface/depth_maps.h"
#include "surface/lattice.h"

typedef struct cn_fusion_block {
    int32_t at[3];                      /* in blocks */
    bool own;                           /* of the region; others lend their values to its border */
    uint8_t seen[CN_LATTICE_POINTS];    /* maps that show something within the band */
    float distance[CN_LATTICE_POINTS];  /* in units of CN_LATTICE_BAND, positive in front of the surface */
    float weight[CN_LATTICE_POINTS];    /* 0: unknown */
    bool moved[CN_LATTICE_POINTS];      /* stereo has moved a depth that counts */
    uint32_t vertex[CN_LATTICE_POINTS]; /* of the cube that begins at the point; UINT32_MAX: none */
} cn_fusion_block;
typedef struct cn_fusion {
    const cn_context *ctx;
    const cn_depth_maps *maps;
    double cube_m;
    cn_surface_distance measure; /* of the source, or NULL */
    void *user;
    cn_fusion_block *blocks;
    uint32_t n, room;
    cn_keys slots;         /* of blocks by their key */
    const uint32_t *which; /* maps that reach the region */
    uint32_t n_which;
} cn_fusion;
/* Adds an empty block. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_fusion_add(cn_fusion *fusion, const int32_t at[3], bool own);
/* Removes all blocks and keeps the memory. */
void cn_fusion_clear(cn_fusion *fusion);
void cn_fusion_deinit(cn_fusion *fusion);
/* Fills distance, weight and seen of every block, on all threads. The result does not depend on their number. */
void cn_fusion_run(cn_fusion *fusion);
#endif
