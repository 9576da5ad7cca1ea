/* Trained tiles, opened as views need them, and a view's blended picture. */
#ifndef CONURB_STAGE_TILE_CACHE_H
#define CONURB_STAGE_TILE_CACHE_H
#include "appearance/spec.h"
#include "conurb/compose.h"
#include "conurb/render.h"

#define CN_TILE_CACHE_BAND 0.03                  /* ownership: the band that two tiles share, of a radius */
enum { CN_TILE_CACHE_MAX = CN_COMPOSE_MAX + 1 }; /* tiles held open: compose.max_tiles + 1 at most */
typedef struct cn_tile_cache {
    const cn_city *city;
    const char *folder; /* of the tiles, relative to the city */
    const cn_plan *plan;
    const cn_dataset *dataset;
    bool varies; /* a tile was opened that looks different under different lights */
    cn_appearance_cache fits;
    double (*centres)[3], *radii;
    uint32_t *which;
    uint32_t n; /* trained tiles of the plan */
    struct {
        uint32_t tile;
        uint64_t used;
        cn_tile *open;
    } cache[CN_TILE_CACHE_MAX];
    uint32_t n_cache;
    uint64_t clock;
    cn_compose_options compose; /* the city's, until the owner of the tiles changes the scheme */
    bool said_none;
} cn_tile_cache;

/* The city's tiles, or those of another folder below it (a trial's): borrowed. CN_ERR_DATA when no tile is trained yet.
 */
CN_NODISCARD cn_status cn_tile_cache_init_at(cn_tile_cache *tiles, const cn_context *ctx, const cn_city *city,
                                          const cn_dataset *dataset, const char *folder);
CN_NODISCARD cn_status cn_tile_cache_init(cn_tile_cache *tiles, const cn_context *ctx, const cn_city *city,
                                       const cn_dataset *dataset);
void cn_tile_cache_deinit(cn_tile_cache *tiles);
/* The open tile of the plan, until the next call. */
CN_NODISCARD cn_status cn_tile_cache_tile(cn_tile_cache *tiles, uint32_t tile, const cn_tile **out);
/* The view from the tiles in reach under a light (NULL: mean), blended. picture is made by the caller at the camera's
 * size. used (may be NULL, 32 bytes): id of the heaviest tile, "" when none is in reach: the picture is then empty, and
 * the log says so the first time. border (may be NULL): as cn_compose_finish has it. owner (may be NULL): by ownership,
 * whose each pixel is, as cn_tile_cache_alone takes it; UINT32_MAX where it is nobody's, and everywhere by the other
 * schemes. */
CN_NODISCARD cn_status cn_tile_cache_view(cn_tile_cache *tiles, const cn_context *ctx, const cn_camera *camera,
                                       const cn_view *view, const cn_render_options *options, const cn_appearance_spec *light,
                                       cn_picture *picture, char *used, float *border, uint32_t *owner);
/* One of the tiles's tiles (below tiles->n) alone, in its reach or not. */
CN_NODISCARD cn_status cn_tile_cache_alone(cn_tile_cache *tiles, const cn_context *ctx, uint32_t tile,
                                        const cn_camera *camera, const cn_view *view, const cn_render_options *options,
                                        const cn_appearance_spec *light, cn_picture *picture);
#endif
