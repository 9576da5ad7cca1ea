/* Trained tiles, opened as views need them, and a view's blended picture. One caller at a time. */
#ifndef CONURB_RENDERER_TILE_CACHE_H
#define CONURB_RENDERER_TILE_CACHE_H
#include "appearance/spec.h"
#include "conurb/compose.h"
#include "conurb/render.h"

#include <sys/stat.h>

#define CN_TILE_CACHE_BLEND_WIDTH 0.03 /* ownership: the width in which two tiles blend, as a part of the radius */
enum { CN_TILE_CACHE_MAX = CN_COMPOSE_MAX + 1 }; /* tiles held open: compose.max_tiles + 1 at most */
typedef struct cn_tile_cache {
    const cn_city *city;
    const char *folder; /* of the tiles, relative to the city */
    const cn_plan *plan;
    const cn_dataset *dataset;
    bool varies; /* a tile was opened that looks different under different appearances */
    cn_appearance_cache fits;
    double (*centres)[3], *radii;
    uint32_t *which;    /* indices of the plan */
    uint32_t n;         /* trained tiles of the plan */
    struct stat *files; /* of each tile of the plan as it was last opened; zero before */
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

/* The city's tiles, trained or not: a city that is in training may have none yet. */
CN_NODISCARD cn_status cn_tile_cache_init_live(cn_tile_cache *tiles, const cn_context *ctx, const cn_city *city,
                                               const cn_dataset *dataset);
/* The city's tiles, or those of another folder below it (an experiment's): borrowed. CN_ERR_DATA when no tile is
 * trained yet. */
CN_NODISCARD cn_status cn_tile_cache_init_at(cn_tile_cache *tiles, const cn_context *ctx, const cn_city *city,
                                             const cn_dataset *dataset, const char *folder);
CN_NODISCARD cn_status cn_tile_cache_init(cn_tile_cache *tiles, const cn_context *ctx, const cn_city *city,
                                          const cn_dataset *dataset);
void cn_tile_cache_deinit(cn_tile_cache *tiles);
/* Closes the tiles that are open; rows stay. */
void cn_tile_cache_close(cn_tile_cache *tiles);
/* Lists the trained tiles again: some may have been trained since, or be in training again. When the list changes, rows
 * that were aligned between the tiles before are forgotten. */
void cn_tile_cache_refresh(cn_tile_cache *tiles);
/* The open tile of the plan, until the next call. A tile whose file changed since it was opened is opened again, and
 * rows that were fitted to tiles before are forgotten. */
CN_NODISCARD cn_status cn_tile_cache_tile(cn_tile_cache *tiles, uint32_t tile, const cn_tile **out);

/* What a picture is of. The camera has the picture's size. */
typedef struct cn_tile_cache_view {
    const cn_camera *camera;
    const cn_view *view;
    const cn_render_options *options;
    const cn_appearance_spec *appearance; /* NULL: the mean */
    const cn_appearance *row;             /* instead, of a single tile */
    char *used;                           /* NULL, or 32 bytes: id of the heaviest tile, "" when none is in reach */
    float *border;                        /* NULL, or as cn_compose_finish has it */
    uint32_t *owner; /* NULL, or by ownership the tile of each pixel, as cn_tile_cache_alone takes it; UINT32_MAX where
                        it is nobody's, and everywhere by the other schemes unless owner_by_all */
    bool owner_by_all; /* owner by any scheme: the tile that has the most part of a pixel */
} cn_tile_cache_view;
/* The view from the tiles in reach, blended. picture is made by the caller. When no tile is in reach the picture is
 * empty, and the log says so the first time. */
CN_NODISCARD cn_status cn_tile_cache_blend(cn_tile_cache *tiles, const cn_context *ctx, const cn_tile_cache_view *view,
                                           cn_picture *picture);
/* One tile alone (below tiles->n), in its reach or not. */
CN_NODISCARD cn_status cn_tile_cache_alone(cn_tile_cache *tiles, const cn_context *ctx, uint32_t tile,
                                           const cn_tile_cache_view *view, cn_picture *picture);
#endif
