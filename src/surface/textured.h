/* A mesh with textures, as glTF (GLB) or as OBJ with MTL. */
#ifndef CONURB_SURFACE_TEXTURED_H
#define CONURB_SURFACE_TEXTURED_H
#include "surface/bake.h"
#include "surface/gltf.h"

typedef struct cn_textured {
    const cn_context *ctx;
    const cn_surface_source *source; /* page_px, shade, colours */
    const cn_mesh_about *about;
    const cn_mesh *mesh;
    double texel_m, reach_m;
    /* NULL, or called while textures are baked, with the part of the work that is done */
    void (*progress)(void *user, double done);
    void *user;
} cn_textured;
typedef struct cn_textured_report {
    uint32_t n_charts, n_pages;
    uint64_t n_texels; /* of all pages */
    double used;       /* part of them that charts cover */
} cn_textured_report;
/* F.glb: JPEG textures inside, a material without lighting for each. F.obj: F.mtl and F-1.jpg, F-2.jpg, ... beside it,
 * with _ for white space in F; all or none of the files are replaced. report may be NULL. Memory: 70 bytes for each
 * triangle, and one page. Scratch files for the encoded pages are made in path's folder. CN_ERR_USAGE: too large for
 * the format. CN_ERR_IO, CN_ERR_NOMEM, CN_ERR_INTERRUPTED: old files stay. */
CN_NODISCARD cn_status cn_textured_write(const cn_textured *textured, const char *path, cn_textured_report *report);
#endif
