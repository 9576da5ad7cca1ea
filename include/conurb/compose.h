/* conurb/compose.h: which tiles a view takes from, with which weights, and their renders as one picture.
 * Distance, visibility: Tancik et al., "Block-NeRF", CVPR 2022, section 3.3. Every scheme is continuous in the camera's
 * place: tiles come and go with weight 0, be it at their reach, at max_tiles or at the visibility threshold. Beyond the
 * reach of every tile there is nothing, and pictures fade to that over the last tenth of the reach. Nothing here keeps
 * state: every function may be called from several threads at once, on different outputs. */
#ifndef CONURB_COMPOSE_H
#define CONURB_COMPOSE_H
#include "conurb/base.h"
#include "conurb/render.h"
#ifdef __cplusplus
extern "C" {
#endif

/* d: horizontal distance from the camera to a tile's centre; p: the exponent. */
typedef enum cn_blend {
    CN_BLEND_NEAREST,     /* the nearest tile alone */
    CN_BLEND_DISTANCE_2D, /* d^-p, one weight a picture */
    CN_BLEND_DISTANCE_3D, /* each pixel: (distance from the point that the tile shows there to the tile's centre)^-p */
    CN_BLEND_VISIBILITY,  /* how much of the view a tile sees (cn_compose_visibility), one weight a picture */
    CN_BLEND_OWNERSHIP    /* each place belongs to its nearest tile, but for a narrow band; rays are marched once
                             (cn_render_union) */
} cn_blend;
CN_API const char *
cn_blend_name(cn_blend blend); /* "nearest", "distance_2d", "distance_3d", "visibility", "ownership" */
CN_API CN_NODISCARD cn_status cn_blend_parse(const char *name,
                                             cn_blend *blend); /* CN_ERR_USAGE names those that there are */

enum { CN_COMPOSE_MAX = 16 };
typedef struct cn_compose_options {
    cn_blend scheme;       /* default CN_BLEND_DISTANCE_2D */
    double exponent;       /* p, >= 0; default 4 */
    double reach;          /* a tile is in reach while d < reach * radius; default 2 */
    uint32_t max_tiles;    /* at most this many, 1 to CN_COMPOSE_MAX; default 4, which the corner of a grid wants */
    double min_visibility; /* a tile that sees less than this part of what the best one sees is left out; 0: none is;
                              default 0.05 */
} cn_compose_options;
CN_API cn_compose_options cn_compose_options_default(void);

/* Weights that sum to 1 over n distances (metres, >= 0). Safe at distance 0 and for any exponent >= 0: the smallest
 * distance is divided by each before the power, so nothing overflows; tiles at distance 0 share the whole weight (with
 * exponent 0 all share alike). Non-finite distances weigh 0; when there is no finite one all weights are 0. weight may
 * be the array distance_m. */
CN_API void cn_compose_weights(uint32_t n, const double *distance_m, double exponent, double *weight);

/* The tiles of one view. weight: of pictures, with the sum 1 (nearest, distance_2d; visibility once it is known); else
 * how far a tile takes part, from 0 (not at all) to 1. */
typedef struct cn_compose_choice {
    uint32_t n;
    uint32_t tile[CN_COMPOSE_MAX + 1]; /* heaviest first; equal ones by index */
    double weight[CN_COMPOSE_MAX + 1]; /* > 0 */
    double coverage; /* 1, falling to 0 where the last tile's reach ends: alpha and colour of the whole */
} cn_compose_choice;
/* Chooses by horizontal distance. distance_2d: (d / smallest d)^-p times (1 - (d / reach)^2)^2, less what the heaviest
 * of those left out has (a hundredth of the heaviest at least). The other schemes take the distance to the reach alone
 * and saturate early. No tile in reach, or a camera that is not finite: n is 0. */
CN_API void cn_compose_choose(uint32_t n_tiles, const double (*centre)[3], const double *radius_m,
                              const double camera[3], const cn_compose_options *options, cn_compose_choice *choice);
/* What part of a view a tile sees, 0 to 1: the share of 32 x 18 rays that end on something within the tile's own box,
 * by their alpha. */
CN_API CN_NODISCARD cn_status cn_compose_visibility(const cn_context *ctx, const cn_tile *tile, const cn_camera *camera,
                                                    const cn_view *view, double *visibility);
/* Weighs in what part of the view each chosen tile sees (visibility[i] of choice->tile[i], 0 to 1), and drops those
 * that see too little: between min_visibility and its double a tile comes in. When all see next to nothing (a view of
 * the sky) all stay. */
CN_API void cn_compose_see(cn_compose_choice *choice, const double *visibility, const cn_compose_options *options);
/* Whether cn_compose_see has anything to do. */
CN_API bool cn_compose_wants_visibility(const cn_compose_choice *choice, const cn_compose_options *options);

/* Pictures of one size summed up by weight: premultiplied colour and alpha by weight, depth by weight and alpha where
 * there is depth. */
typedef struct cn_compose_sum {
    cn_picture *out;                                           /* borrowed */
    float *log_scale, *weight, *depth_weight, *second, *first; /* a pixel each */
    uint32_t
        *heaviest; /* NULL, or (the caller's, set after init) each pixel's heaviest picture, in order of addition */
    uint32_t n;    /* pictures so far */
} cn_compose_sum;
/* out is overwritten. CN_ERR_NOMEM. Caller deinits, which leaves out alone. */
CN_API CN_NODISCARD cn_status cn_compose_sum_init(cn_compose_sum *sum, cn_picture *out);
CN_API void cn_compose_sum_deinit(cn_compose_sum *sum);
/* One weight for the whole picture. */
CN_API void cn_compose_add(cn_compose_sum *sum, const cn_picture *picture, double weight);
/* distance_3d: each pixel's weight is `weight` times the distance from what the picture shows there to `centre`, to the
 * power of -exponent. Where a picture has no depth it shows something far away. */
typedef struct cn_compose_distance {
    const cn_camera *camera; /* of the picture, and its size */
    const cn_view *view;
    const double *centre; /* [3], metres in the local frame */
    double weight, exponent;
} cn_compose_distance;
/* The sums are kept in a running scale, so any exponent is safe. ctx NULL: in this thread alone. */
CN_API void cn_compose_add_3d(const cn_context *ctx, cn_compose_sum *sum, const cn_picture *picture,
                              const cn_compose_distance *distance);
/* Divides by the weights, and scales colour and alpha by coverage. border (may be NULL): each pixel's second heaviest
 * share, 0 to 0.5. */
CN_API void cn_compose_finish(cn_compose_sum *sum, double coverage, float *border);

/* What a picture shows where no tile has anything (alpha below 1). FILL: the colours around it, by push and pull over a
 * pyramid (Gortler et al. 1996, "The Lumigraph"). NEUTRAL: the same for holes of up to a thirtieth of the picture, and
 * a grey of 18 % elsewhere. BLACK: nothing. */
typedef enum cn_unseen { CN_UNSEEN_FILL, CN_UNSEEN_NEUTRAL, CN_UNSEEN_BLACK } cn_unseen;
/* Changes colour and alpha in place; depth stays. Every pixel becomes opaque, but for CN_UNSEEN_BLACK and where there
 * is nothing to fill from. For pictures that are looked at: whoever composites needs the alpha. CN_ERR_NOMEM: nothing
 * has changed. */
CN_API CN_NODISCARD cn_status cn_compose_unseen(cn_picture *picture, cn_unseen unseen);

/* ---- one light in all tiles ----
 * Each tile learned the light of its own photos, so one code looks different in each. From a root tile on, each tile's
 * row is fitted by l2 to the renders of its neighbours that are matched already, all of them at once, in places that
 * both see (Block-NeRF, section 3.3). */

/* A tile as a match needs it. Borrowed. */
typedef struct cn_alignment_tile {
    const char *id;
    double centre[3], radius_m;
    const uint32_t *views;
    uint32_t n_views; /* of the scene: the photos that it was trained on */
} cn_alignment_tile;
typedef struct cn_alignment_input {
    const cn_scene *scene;
    const cn_alignment_tile *tiles;
    uint32_t n_tiles;
    uint32_t root; /* UINT32_MAX: the tile with the most photos */
    /* Opens a tile: good until the next call. The match holds one at a time. */
    cn_status (*open)(void *user, uint32_t tile, const cn_tile **out);
    /* The light as the tile itself has it: of the root, and where the others' fits begin. */
    cn_status (*appearance)(void *user, const cn_context *ctx, const cn_tile *tile, cn_appearance *row);
    void *user;
} cn_alignment_input;

/* Two tiles that see the same places. rmse: between their renders there, display-encoded, when the one that was matched
 * later had its own row and with its matched one; NaN where too few places were seen by both. */
typedef struct cn_alignment_edge {
    uint32_t a, b, n_places;
    double own_rmse, rmse;
} cn_alignment_edge;
typedef struct cn_alignment {
    uint32_t n_tiles;
    cn_appearance *rows; /* of each tile */
    uint32_t *group; /* of each tile: tiles of different groups share no places, so their light could not be compared */
    uint32_t *order; /* tiles as they were matched; each group begins with its root */
    cn_alignment_edge *edges;
    uint32_t n_edges;
    uint32_t n_groups;
} cn_alignment;
/* Tiles whose rows cannot change anything keep them. The log says where a group begins that shares no places with the
 * others. Reports progress as stage "match". CN_ERR_INTERRUPTED when asked to stop. Caller deinits, also after a
 * failure (empty then). */
CN_API CN_NODISCARD cn_status cn_appearance_align(const cn_context *ctx, const cn_alignment_input *input,
                                                  cn_alignment *alignment);
CN_API void cn_alignment_deinit(cn_alignment *alignment);

#ifdef __cplusplus
}
#endif
#endif
