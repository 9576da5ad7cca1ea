/* conurb/compose.h: chooses the tiles of a view and their weights, and blends their renders into one picture.
 *
 * Distance and visibility weights: Tancik et al., "Block-NeRF", CVPR 2022, section 3.3. Every scheme is continuous in
 * the camera's position: a tile enters and leaves with weight 0, at the end of its reach, at max_tiles and at the
 * visibility threshold. Outside the reach of all tiles the picture is empty; it fades out over the last tenth of the
 * reach.
 *
 * No function keeps state. Several threads may call them at the same time, on different outputs. */
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
    CN_BLEND_DISTANCE_2D, /* d^-p, one weight per picture */
    CN_BLEND_DISTANCE_3D, /* per pixel: d is the distance from the surface point that the tile renders to the tile's
                             centre */
    CN_BLEND_VISIBILITY,  /* the part of the view that a tile sees (cn_compose_visibility), one weight per picture */
    CN_BLEND_OWNERSHIP    /* each place belongs to the nearest tile, with a narrow blend at borders; each ray is marched
                             once through all tiles (cn_render_union) */
} cn_blend;
/* "nearest", "distance_2d", "distance_3d", "visibility" or "ownership". A constant string. */
CN_API const char *cn_blend_name(cn_blend blend);
/* The scheme of that name. CN_ERR_USAGE: an unknown name; the message lists the known ones. */
CN_API CN_NODISCARD cn_status cn_blend_parse(const char *name, cn_blend *blend);

enum { CN_COMPOSE_MAX = 16 };
typedef struct cn_compose_options {
    cn_blend scheme;       /* default CN_BLEND_DISTANCE_2D */
    double exponent;       /* p, >= 0; default 4 */
    double reach;          /* a tile is in reach while d < reach * radius; default 2 */
    uint32_t max_tiles;    /* tiles per view at most, 1 to CN_COMPOSE_MAX; default 4: as many meet at a grid corner */
    double min_visibility; /* a tile is left out when its visibility is below this fraction of the largest; 0: none is
                              left out; default 0.05 */
} cn_compose_options;
CN_API cn_compose_options cn_compose_options_default(void);

/* The radius by which cn_compose_choose chooses a tile: its own, or a larger one where photos of the tile stand farther
 * from its centre (farthest_m, horizontal), so that each of them sees the tile in full. A drone stands outside the tile
 * that it looks at. Metres. */
CN_API double cn_compose_radius(double radius_m, double farthest_m, const cn_compose_options *options);

/* Fills weight[n], proportional to distance_m^-exponent, with the sum 1. Distances are in metres, >= 0; exponent >= 0.
 * Nothing overflows: the smallest distance is divided by each distance before the power. Tiles at distance 0 share the
 * whole weight equally; with exponent 0 all tiles do. A distance that is not finite has weight 0; when none is finite,
 * all weights are 0. weight and distance_m may be the same array. */
CN_API void cn_compose_weights(uint32_t n, const double *distance_m, double exponent, double *weight);

/* The tiles of one view. For nearest, distance_2d and visibility (after cn_compose_see) the weights sum to 1. For the
 * other schemes a weight says how far a tile has faded in, from 0 to 1. */
typedef struct cn_compose_choice {
    uint32_t n;
    uint32_t tile[CN_COMPOSE_MAX + 1]; /* by falling weight; equal weights by index */
    double weight[CN_COMPOSE_MAX + 1]; /* > 0 */
    double coverage; /* factor of the picture's colour and alpha: 1, falling to 0 at the end of the last tile's reach */
} cn_compose_choice;
/* Chooses tiles by horizontal distance d. centre[n_tiles], radius_m[n_tiles] (cn_compose_radius) and camera: metres,
 * local frame.
 * distance_2d: a tile's weight is (d / smallest d)^-p times (1 - (d / reach)^2)^2, less the largest weight among the
 * tiles left out (at least a hundredth of the largest weight). The other schemes fade a tile in by its distance to the
 * end of its reach alone. n is 0 when no tile is in reach or the camera's position is not finite. */
CN_API void cn_compose_choose(uint32_t n_tiles, const double (*centre)[3], const double *radius_m,
                              const double camera[3], const cn_compose_options *options, cn_compose_choice *choice);
/* The part of a view that a tile sees, 0 to 1: the mean alpha over 32 x 18 rays, counting those that end inside the
 * tile's box. */
CN_API CN_NODISCARD cn_status cn_compose_visibility(const cn_context *ctx, const cn_tile *tile, const cn_camera *camera,
                                                    const cn_view *view, double *visibility);
/* Applies visibility[i] (0 to 1, of choice->tile[i]) to the weights. CN_BLEND_VISIBILITY multiplies by it. With every
 * scheme, tiles that see too little are dropped; a tile fades in between min_visibility and twice that. When all tiles
 * see almost nothing (a view of the sky), all stay. */
CN_API void cn_compose_see(cn_compose_choice *choice, const double *visibility, const cn_compose_options *options);
/* Whether the choice depends on visibility, so that cn_compose_see must be called. */
CN_API bool cn_compose_wants_visibility(const cn_compose_choice *choice, const cn_compose_options *options);

/* A weighted sum of pictures of one size. Where a picture is transparent, its tile holds nothing, and says nothing of
 * what others hold: a picture's share of a pixel is its weight times its alpha. Colours are mixed by share, and so are
 * depths, of the pictures that have one. Alpha is that of the surest pictures; where they have less than a fifth of the
 * weight, it falls to the mean by weight, so that a picture of weight 0 changes nothing. Pictures that agree come out
 * as they are. */
typedef struct cn_compose_sum {
    cn_picture *out; /* borrowed */
    /* one value per pixel */
    float *log_scale, *weight, *depth_weight, *second, *first, *surest, *sure_weight, *sure_square;
    /* NULL, or a buffer of the caller, set after init: per pixel the index (in order of addition) of the picture with
     * the largest share; unchanged where all are transparent */
    uint32_t *heaviest;
    uint32_t n; /* pictures so far */
} cn_compose_sum;
/* Begins a sum into out, which is overwritten. CN_ERR_NOMEM. The caller calls deinit, which does not free out. */
CN_API CN_NODISCARD cn_status cn_compose_sum_init(cn_compose_sum *sum, cn_picture *out);
CN_API void cn_compose_sum_deinit(cn_compose_sum *sum);
/* Adds a picture with one weight. */
CN_API void cn_compose_add(cn_compose_sum *sum, const cn_picture *picture, double weight);
/* Weights of distance_3d: a pixel's weight is `weight` times D^-exponent, where D is the distance from the pixel's
 * surface point to `centre`. A pixel without depth counts as far away. */
typedef struct cn_compose_distance {
    const cn_camera *camera; /* the picture's camera, at the picture's size */
    const cn_view *view;
    const double *centre; /* [3], metres in the local frame */
    double weight, exponent;
} cn_compose_distance;
/* Adds a picture with one weight per pixel. Any exponent is safe: the sums are rescaled as they grow. ctx NULL: only
 * the calling thread works. */
CN_API void cn_compose_add_3d(const cn_context *ctx, cn_compose_sum *sum, const cn_picture *picture,
                              const cn_compose_distance *distance);
/* Divides the sums by the weights. border: NULL, or height * width floats: per pixel the second largest share, 0 to
 * 0.5. */
CN_API void cn_compose_finish(cn_compose_sum *sum, float *border);
/* Multiplies the colour and alpha of a whole picture by coverage (0 to 1, cn_compose_choice) and notes it in
 * picture->fade, so that cn_compose_unseen does not take what fades for unseen. */
CN_API void cn_compose_fade(cn_picture *picture, double coverage);

/* What a picture shows where the tiles hold nothing (alpha below 1). FILL: the surrounding colours, interpolated by
 * push-pull over an image pyramid (Gortler et al. 1996, "The Lumigraph"). NEUTRAL: the same for holes up to a
 * thirtieth of the picture, and 18 % grey elsewhere. BLACK: black. */
typedef enum cn_unseen { CN_UNSEEN_FILL, CN_UNSEEN_NEUTRAL, CN_UNSEEN_BLACK } cn_unseen;
/* Fills a picture in place: colour and alpha change, depth does not. depth may be NULL; with it a hole in the ground
 * just below the horizon is filled whole, where it has a tinge of sky. Every pixel becomes opaque, except with
 * CN_UNSEEN_BLACK and where there is no colour to fill from. A picture with picture->fade is filled as it was before it
 * faded, and the result fades towards black. One with picture->wraps has no edge at its left and right. Meant for
 * pictures that people look at; compositing needs the alpha as it was. CN_ERR_NOMEM: the picture has not changed. */
CN_API CN_NODISCARD cn_status cn_compose_unseen(cn_picture *picture, cn_unseen unseen);

/* ---- appearance alignment between tiles ----
 *
 * Each tile learned appearances from its own photos, so the same code looks different in each tile. Alignment begins
 * at a root tile. It fits each further tile's row by least squares to the renders of all neighbours that are aligned
 * already, at places that both tiles see (Block-NeRF, section 3.3). */

/* One tile to align. Borrowed. */
typedef struct cn_alignment_tile {
    const char *id;
    double centre[3], radius_m;
    const uint32_t *views;
    uint32_t n_views; /* indices of the scene's views that the tile was trained on */
} cn_alignment_tile;
typedef struct cn_alignment_input {
    const cn_scene *scene;
    const cn_alignment_tile *tiles;
    uint32_t n_tiles;
    uint32_t root; /* UINT32_MAX: the tile with the most photos */
    /* Opens a tile. It must stay valid until the next call; one tile is used at a time. */
    cn_status (*open)(void *user, uint32_t tile, const cn_tile **out);
    /* The tile's own row for the wanted appearance: the root keeps it, the fits of the others start from it. */
    cn_status (*appearance)(void *user, const cn_context *ctx, const cn_tile *tile, cn_appearance *row);
    void *user;
} cn_alignment_input;

/* Two tiles that see the same places. own_rmse and rmse: difference of their renders there, display-encoded, before
 * and after the alignment of the later one. NaN: too few places are seen by both. */
typedef struct cn_alignment_edge {
    uint32_t a, b, n_places;
    double own_rmse, rmse;
} cn_alignment_edge;
typedef struct cn_alignment {
    uint32_t n_tiles;
    cn_appearance *rows; /* one row per tile */
    uint32_t *group;     /* one per tile; tiles of different groups share no places and are not aligned to each other */
    uint32_t *order;     /* tiles in the order of alignment; each group begins with its root */
    cn_alignment_edge *edges;
    uint32_t n_edges;
    uint32_t n_groups;
} cn_alignment;
/* Aligns the appearance of all tiles. A tile whose row has no effect keeps it. The log names each group of tiles that
 * shares no places with the others. Reports progress as stage "match". CN_ERR_INTERRUPTED: asked to stop. The caller
 * calls cn_alignment_deinit, also after a failure; the alignment is empty then. */
CN_API CN_NODISCARD cn_status cn_appearance_align(const cn_context *ctx, const cn_alignment_input *input,
                                                  cn_alignment *alignment);
CN_API void cn_alignment_deinit(cn_alignment *alignment);

#ifdef __cplusplus
}
#endif
#endif
