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
} cn_city_surface;
/* Writes the surface to path, a file or a folder; logs its size. */
CN_NODISCARD cn_status cn_city_surface_make(const cn_context *ctx, const cn_city_surface *surface, const char *path);
#endif
