/* Opens trained tiles as views need them, and renders views. One caller at a time. */
#ifndef CONURB_RENDERER_TILE_CACHE_H
#define CONURB_RENDERER_TILE_CACHE_H
#include "appearance/lens.h"
#include "appearance/spec.h"
#include "conurb/compose.h"
#include "conurb/render.h"
#include "renderer/photo_depths.h"

#include <sys/stat.h>

#define CN_TILE_CACHE_BLEND_WIDTH                                                                                      \
    0.03 /* ownership: width of the blend between two tiles, as a fraction of the radius */
enum { CN_TILE_CACHE_MAX = CN_COMPOSE_MAX + 1 }; /* tiles held open: compose.max_tiles + 1 at most */
typedef struct cn_tile_cache {
    const cn_city *city;
    const char *folder; /* folder of the tiles, relative to the city */
    const cn_plan *plan;
    const cn_dataset *dataset;
    bool varies; /* a tile was opened that has appearance */
    cn_appearance_cache fits;
    double (*centres)[3], *radii;
    double *seen_radii; /* cn_compose_radius: what views choose tiles by */
    bool live;          /* tiles in training are shown as their last checkpoint has them */
    uint32_t *which;    /* indices of the plan */
    uint32_t n;         /* number of trained tiles of the plan */
    struct stat *files; /* of each tile of the plan when it was last opened; zero before */
    struct {
        uint32_t tile;
        uint64_t used;
        cn_tile *open;
    } cache[CN_TILE_CACHE_MAX];
    uint32_t n_cache;
    uint64_t clock;
    cn_compose_options compose; /* from the city; the owner may change the scheme */
    bool said_none;
    cn_photo_depths *depths; /* NULL, or one for each tile of the plan, made when a view needs it */
} cn_tile_cache;

/* Begins with the city's tiles. A city in training may have no trained tile yet. unfinished: tiles in training are
 * shown as their last checkpoint has them. */
CN_NODISCARD cn_status cn_tile_cache_init_live(cn_tile_cache *tiles, const cn_context *ctx, const cn_city *city,
                                               const cn_dataset *dataset, bool unfinished);
/* Begins with the city's tiles, or with those of another folder in it (of an experiment). Arguments are borrowed.
 * CN_ERR_DATA: no tile is trained yet. */
CN_NODISCARD cn_status cn_tile_cache_init_at(cn_tile_cache *tiles, const cn_context *ctx, const cn_city *city,
                                             const cn_dataset *dataset, const char *folder);
CN_NODISCARD cn_status cn_tile_cache_init(cn_tile_cache *tiles, const cn_context *ctx, const cn_city *city,
                                          const cn_dataset *dataset);
void cn_tile_cache_deinit(cn_tile_cache *tiles);
/* Closes the open tiles and keeps the rows. */
void cn_tile_cache_close(cn_tile_cache *tiles);
/* Lists the trained tiles again, because the list may have changed. If so, rows that were aligned between the old
 * tiles are removed. */
void cn_tile_cache_refresh(cn_tile_cache *tiles);
/* A tile of the plan, open until the next call. If its file has changed, it is opened again, and fitted rows are
 * removed. */
CN_NODISCARD cn_status cn_tile_cache_tile(cn_tile_cache *tiles, uint32_t tile, const cn_tile **out);
/* The vignetting of a view of the dataset, as the tile with this id took it out of its photos (appearance/lens.h); none
 * for an id that the plan lacks. */
CN_NODISCARD cn_status cn_tile_cache_vignetting(cn_tile_cache *tiles, const char *id, const cn_view *view,
                                                cn_vignetting *v);

/* What to render. The camera has the picture's size. */
typedef struct cn_tile_cache_view {
    const cn_camera *camera;
    const cn_view *view;
    const cn_render_options *options;
    const cn_appearance_spec *appearance; /* NULL: the mean */
    const cn_appearance *row;             /* instead: a row, for a single tile */
    char *used;                           /* NULL, or 32 bytes: id of the heaviest tile, "" when none is in reach */
    float *border;                        /* NULL, or as cn_compose_finish has it */
    uint32_t *owner;   /* NULL, or the tile of each pixel, as in cn_tile_cache_alone; UINT32_MAX: none. Only with
                          ownership, unless owner_by_all */
    bool owner_by_all; /* fill `owner` with every scheme: the tile with the largest share */
} cn_tile_cache_view;
/* Renders a view from the tiles in reach, blended, into the caller's picture. When no tile is in reach, the picture is
 * empty; the log says so the first time. */
CN_NODISCARD cn_status cn_tile_cache_blend(cn_tile_cache *tiles, const cn_context *ctx, const cn_tile_cache_view *view,
                                           cn_picture *picture);
/* Renders one tile (below tiles->n) alone, even out of its reach. */
CN_NODISCARD cn_status cn_tile_cache_alone(cn_tile_cache *tiles, const cn_context *ctx, uint32_t tile,
                                           const cn_tile_cache_view *view, cn_picture *picture);
#endif
