/* conurb/plan.h: splits a scene into overlapping tiles. */
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
#define CN_MAX_EFFECTS 8

typedef enum cn_layout { CN_LAYOUT_AUTO, CN_LAYOUT_GRID, CN_LAYOUT_CENTRES } cn_layout;

typedef struct cn_plan_effect {
    char name[24]; /* "view_dependence", "appearance", "exposure", "transient", "pose_refinement", "sky" */
    bool on;
    double evidence, threshold; /* evidence is NaN when it cannot be measured */
    char reason[64];            /* "evidence", "city.yaml", "not measurable" */
    double cost_s;
    int64_t cost_bytes; /* what it adds, or would add, to the tile's training */
} cn_plan_effect;

typedef struct cn_plan_tile {
    char id[CN_TILE_ID_SIZE]; /* MGRS of the centre (or "L" + local metres without GPS); unique in the plan; safe as a
                                 folder name */
    double centre[3];         /* local metres */
    double radius_m;          /* horizontal; photos within it belong to the tile */
    double bounds_min[3],
        bounds_max[3];    /* box that holds the tile's cameras and the points they see; near field of the tile */
    double near_m, far_m; /* along rays, from the sparse points (or the cameras' layout when there are none) */
    uint32_t *photos;
    uint32_t n_photos; /* view indices, ascending; for training */
    uint32_t *held_out;
    uint32_t n_held_out; /* view indices, ascending; never trained on */
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
    const cn_pixel_store *pixels; /* for evidence from colours; may be NULL */
} cn_plan_input;

/* How one effect is judged. The registry of effects lends these, so that a plan knows of no effect by name. */
typedef struct cn_effect_rule {
    const char *name;
    double threshold;
    /* Evidence for the tile, NaN when it cannot be measured. NULL: never on by evidence. Called on the pool's threads;
     * input and tile may be a part of the city that stands for the tile. */
    double (*evidence)(const cn_plan_input *input, const cn_plan_tile *tile);
    cn_tristate wanted; /* from city.yaml */
    bool on_unmeasured; /* the decision when evidence is NaN and wanted is CN_AUTO */
} cn_effect_rule;

/* Predicted cost of training a tile with that many photos and those effects. Called on the pool's threads. */
typedef void (*cn_cost_model)(void *user, const cn_plan_tile *tile, double *seconds, uint64_t *bytes);

typedef struct cn_plan_options {
    cn_layout layout;
    const char *centres; /* GeoJSON of points for CN_LAYOUT_CENTRES */
    double spacing_m;    /* 0: chosen from the cameras; distance between neighbouring centres */
    double overlap;      /* fraction of a tile's diameter shared with a neighbour at distance spacing: 1 - spacing / (2
                            radius); default 0.5 */
    double min_points_seen;  /* a photo outside the radius belongs when at least this fraction of the points it sees lie
                                inside; default 0.3 */
    uint32_t min_photos;     /* tiles with fewer are merged into a neighbour or dropped; default 4 */
    uint32_t hold_out_every; /* default 8; 0: none */
    uint32_t max_tile_photos; /* a tile's training photos are thinned to so many; default 0: no limit */
    uint64_t
        max_tile_bytes; /* and further, until cost says that training takes no more memory; default 8e9; 0: no limit */
    const cn_effect_rule *rules;
    uint32_t n_rules;
    cn_cost_model cost;
    void *cost_user; /* may be NULL */
} cn_plan_options;
CN_API cn_plan_options cn_plan_options_default(void);

/* Held-out photos are every hold_out_every-th view by name over the whole scene (0, 8, 16 ...), so a photo held out of
 * one tile is held out of all. A tile beyond its budgets trains on some of its photos: ranked by where they stand and
 * which way they look, every n-th is kept, so that each place and direction keeps its share; its held-out photos are
 * thinned in proportion. Evidence is measured on at most 512 of a tile's photos, in runs of neighbours by the same
 * rank. Works on a tile a thread of ctx. O(observations) in time and memory. CN_ERR_DATA when no tile has enough
 * photos. */
CN_API CN_NODISCARD cn_status cn_plan_make(const cn_context *ctx, const cn_plan_input *input,
                                           const cn_plan_options *options, cn_plan *plan);
CN_API void cn_plan_deinit(cn_plan *plan);
/* plan.json, tiles.geojson (WGS84 when georeferenced) and plan.svg in dir; plan.json last. Views are stored by name; in
 * plans with more than 100,000 names as runs of view indices ("0-15 17") with the hash of all names, by which loading
 * knows that poses changed (CN_ERR_DATA). */
CN_API CN_NODISCARD cn_status cn_plan_save(const cn_plan *plan, const cn_plan_input *input, const char *dir);
CN_API CN_NODISCARD cn_status cn_plan_load(cn_plan *plan, const cn_scene *scene, const char *dir);
/* Index of the tile of that id, or -1. */
CN_API int64_t cn_plan_find(const cn_plan *plan, const char *id);

#ifdef __cplusplus
}
#endif
#endif
