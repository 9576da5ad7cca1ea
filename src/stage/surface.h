/* The surface of a city's trained tiles, as cn_surface_export makes it. */
#ifndef CONURB_STAGE_SURFACE_H
#define CONURB_STAGE_SURFACE_H
#include "conurb/surface.h"
#include "renderer/renderer.h"
#include "stage/survey.h"

typedef struct cn_city_surface {
    cn_renderer *renderer;   /* with the appearance aligned */
    const cn_survey *survey; /* its tiles and colours */
    const cn_appearance_spec *appearance;
    double cube_m;        /* 0: cn_export_gsd */
    bool tiles;           /* as 3D Tiles to a folder, not to a file */
    uint64_t n_triangles; /* as in cn_surface_source */
    uint32_t page_px;
    double texel_m;
    const cn_pixel_store *pixels; /* as in cn_surface_source */
} cn_city_surface;
/* The photos that a mesh's depths are moved by, or NULL: without pixels, or as `depths` says
 * (cn_city_export_options). CN_ERR_USAGE: an unknown word. */
CN_NODISCARD cn_status cn_city_surface_photos(const cn_context *ctx, const cn_dataset *dataset, const char *depths,
                                              const cn_pixel_store **pixels);
/* Writes the surface to path, a file or a folder; logs its size. */
CN_NODISCARD cn_status cn_city_surface_make(const cn_context *ctx, const cn_city_surface *surface, const char *path);
#endif
