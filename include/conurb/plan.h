/* conurb/plan.h: splits a scene into overlapping tiles, and decides which effects each tile is trained with. */
#ifndef CONURB_PLAN_H
#define CONURB_PLAN_H
#include "conurb/base.h"
#include "conurb/geo.h"
#include "conurb/photo.h"
#include "conurb/pose.h"
#ifdef __cplusplus
extern "C" {
#endif

#define CN_TILE_ID_SIZE 32
#define CN_MAX_EFFECTS 16

typedef enum cn_layout { CN_LAYOUT_AUTO, CN_LAYOUT_GRID, CN_LAYOUT_CENTRES } cn_layout;

typedef struct cn_plan_effect {
    char name[24]; /* "view_dependence", "appearance", "exposure", "transient", "pose_refinement", "sky",
                    * "stereo_depth", "vignetting" */
    bool on;
    double evidence, threshold; /* NaN evidence: it cannot be measured */
    char reason[64];            /* "evidence", "city.yaml", "not measurable", or the result of a short training, as in
                                 * "probe: +0.3 dB" */
    double cost_s;
    int64_t cost_bytes; /* seconds and bytes that it adds, or would add, to the tile's training */
} cn_plan_effect;

typedef struct cn_plan_tile {
    char id[CN_TILE_ID_SIZE]; /* MGRS of the centre; without GPS "L" and local metres. Unique in the plan, and valid as
                                 a folder name */
    double centre[3];         /* local metres */
    double radius_m;          /* horizontal; photos inside it belong to the tile */
    double bounds_min[3], bounds_max[3]; /* box of the tile's cameras, but for those many times as far away as most, and
                                            of the points that they see; the field contracts space outside it */
    double near_m, far_m; /* along rays, metres; from the sparse points, or from the cameras' layout without points */
    uint32_t *photos;
    uint32_t n_photos; /* indices of the views to train on, ascending */
    uint32_t *held_out;
    uint32_t n_held_out; /* indices of the held-out views, ascending; training never sees them */
    cn_plan_effect effects[CN_MAX_EFFECTS];
    uint32_t n_effects;
    double estimate_s;
    uint64_t estimate_bytes;
} cn_plan_tile;

typedef struct cn_plan {
    cn_plan_tile *tiles;
    uint32_t n_tiles; /* sorted by id */
    double overlap;
    cn_layout layout;
    char **warnings;
    uint32_t n_warnings;
} cn_plan;

typedef struct cn_plan_input {
    const cn_scene *scene;
    const cn_photo_index *photos;
    const cn_frame *frame;
    const cn_pixel_store *pixels; /* for evidence from colours; NULL: no such evidence */
} cn_plan_input;

/* How the plan decides about one effect. The effect registry provides one rule for each effect. */
typedef struct cn_effect_rule {
    const char *name;
    double threshold;
    /* The evidence for the tile; NaN when it cannot be measured. NULL: evidence never turns the effect on. Called on
     * pool threads. input and tile may be a sample of the tile's photos. */
    double (*evidence)(const cn_plan_input *input, const cn_plan_tile *tile);
    cn_tristate wanted; /* from city.yaml */
    bool on_unmeasured; /* the decision when evidence is NaN and wanted is CN_AUTO */
} cn_effect_rule;

/* Predicts what training costs for a tile with these photos and effects. Called on pool threads. */
typedef void (*cn_cost_model)(void *user, const cn_plan_tile *tile, double *seconds, uint64_t *bytes);

typedef struct cn_plan_options {
    cn_layout layout;
    const char *centres; /* GeoJSON of points for CN_LAYOUT_CENTRES */
    double spacing_m;    /* distance between neighbouring centres; 0: chosen from the cameras */
    double overlap;      /* fraction of a tile's diameter that it shares with the next tile: 1 - spacing / (2 * radius);
                            default 0.5 */
    double min_points_seen;  /* a photo outside the radius belongs to the tile when at least this fraction of the points
                                that it sees lie inside; default 0.3 */
    uint32_t min_photos;     /* a tile with fewer is merged into a neighbour or dropped; default 4 */
    uint32_t hold_out_every; /* every n-th view is held out; default 8; 0: none */
    uint32_t max_tile_photos; /* training photos per tile at most; default 0: no limit */
    /* Memory of a tile's training at most, as `cost` predicts it: photos are dropped until it fits. Default 8e9; 0: no
     * limit */
    uint64_t max_tile_bytes;
    const cn_effect_rule *rules;
    uint32_t n_rules;
    cn_cost_model cost;
    void *cost_user; /* may be NULL */
} cn_plan_options;
CN_API cn_plan_options cn_plan_options_default(void);

/* Makes a plan. Every hold_out_every-th view of the whole scene, by name, is held out (0, 8, 16 ...): a photo that is
 * held out of one tile is held out of all.
 *
 * When a tile exceeds a limit, some of its photos are dropped. The photos are ranked by position and direction, and
 * every n-th is kept, so that each place and direction keeps its share. Held-out photos are thinned in proportion.
 * Evidence is measured on at most 512 of a tile's photos, in runs of neighbours of the same ranking.
 *
 * Tiles are worked on in parallel, one per thread of ctx. Time and memory are O(observations). The caller frees the
 * plan with cn_plan_deinit. CN_ERR_DATA: no tile has enough photos. */
CN_API CN_NODISCARD cn_status cn_plan_make(const cn_context *ctx, const cn_plan_input *input,
                                           const cn_plan_options *options, cn_plan *plan);
CN_API void cn_plan_deinit(cn_plan *plan);
/* Writes plan.json, tiles.geojson (WGS84 when georeferenced) and plan.svg to dir, plan.json last. Views are stored by
 * name. A plan with more than 100,000 names stores runs of view indices ("0-15 17") and a hash of all names. Loading
 * gives CN_ERR_DATA when that hash differs: the poses have changed since. */
CN_API CN_NODISCARD cn_status cn_plan_save(const cn_plan *plan, const cn_plan_input *input, const char *dir);
CN_API CN_NODISCARD cn_status cn_plan_load(cn_plan *plan, const cn_scene *scene, const char *dir);
/* The index of the tile with that id, or -1. */
CN_API int64_t cn_plan_find(const cn_plan *plan, const char *id);

#ifdef __cplusplus
}
#endif
#endif
