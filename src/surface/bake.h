/* Colours of the texels of a page. */
#ifndef CONURB_SURFACE_BAKE_H
#define CONURB_SURFACE_BAKE_H
#include "conurb/surface.h"
#include "surface/atlas.h"

typedef struct cn_bake {
    const cn_context *ctx;
    const cn_surface_source *source;
    const cn_mesh *mesh;
    const cn_charts *charts;
    double reach_m; /* a ray begins and ends so far from the surface */
    /* NULL, or called after each batch with the number of texels that it had */
    void (*progress)(void *user, size_t texels);
    void *user;
} cn_bake;
/* Bakes a page: *rgb[side_px * side_px * 3], display-encoded, rows top down; the caller frees it. A texel's colour is
 * what a short ray through the surface shows, from where the photos see it. Where the field shows nothing it is that
 * of the vertices. Texels beside charts repeat those within. Memory: 4 bytes for each texel, and 9 MB.
 * CN_ERR_NOMEM, CN_ERR_INTERRUPTED. */
CN_NODISCARD cn_status cn_bake_page(const cn_bake *bake, const cn_atlas_page *page, uint8_t **rgb);
#endif
