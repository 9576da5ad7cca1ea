/* conurb/render.h: one tile's picture of one view. */
#ifndef CONURB_RENDER_H
#define CONURB_RENDER_H
#include "conurb/base.h"
#include "conurb/pose.h"
#include "conurb/tile.h"
#ifdef __cplusplus
extern "C" {
#endif

/* Linear ACEScg, premultiplied by alpha. depth in metres along the ray (expected depth over alpha), 0 where alpha is 0.
 */
typedef struct cn_picture {
    uint32_t width, height;
    float *rgba;  /* height * width * 4, rows top down */
    float *depth; /* height * width */
} cn_picture;
CN_API CN_NODISCARD cn_status cn_picture_init(cn_picture *picture, uint32_t width, uint32_t height); /* zeroed */
CN_API void cn_picture_deinit(cn_picture *picture);

typedef struct cn_render_options {
    double exposure_ev;              /* stops, relative to the tile's reference exposure; applied as a gain */
    const cn_appearance *appearance; /* a row of this tile, or NULL for the mean of its photos */
    double min_transmittance;        /* a ray stops below it; default 1e-3 */
    /* > 0: depth is where so much of a ray is left. 0: depth is the mean, which haze draws near. */
    double depth_left;
    /* NULL, or a count to which the places are added at which the fields were asked, block by block (atomically). */
    uint64_t *samples;
} cn_render_options;
CN_API cn_render_options cn_render_options_default(void);

/* Renders the view (camera at the picture's size) of a tile. The picture is allocated by the caller. */
CN_API CN_NODISCARD cn_status cn_render_tile(const cn_context *ctx, const cn_tile *tile, const cn_camera *camera,
                                             const cn_view *view, const cn_render_options *options,
                                             cn_picture *picture);

/* The same along rays of one's own. Writes rgba[n][4] (as in cn_picture) and depth_m[n] (along the ray); an
 * orthographic view, a height sample. Caller owns all buffers. */
CN_API CN_NODISCARD cn_status cn_render_rays(const cn_context *ctx, const cn_tile *tile, const cn_ray_list *rays,
                                             const cn_render_options *options, float *rgba, float *depth_m);

/* ---- tiles that share space ---- */
/* One tile of a union. A place belongs to the tile whose centre is nearest on the map; offset_m is added to a tile's
 * distance. A tile whose distance is larger than the smallest one by less than its blend_width_m has a part of the
 * place too. The parts sum to 1 everywhere. */
typedef struct cn_union_part {
    const cn_tile *tile;
    double centre_m[3];
    double blend_width_m;            /* > 0 */
    double offset_m;                 /* >= 0; INFINITY for a tile that owns nothing */
    const cn_appearance *appearance; /* a row of this tile, or NULL for the mean of its photos */
} cn_union_part;
enum { CN_UNION_MAX = 16 };
typedef struct cn_union {
    uint32_t n; /* 1 to CN_UNION_MAX */
    const cn_union_part *parts;
} cn_union;
/* What a union's render writes; all of it is the caller's. */
typedef struct cn_union_output {
    cn_picture *picture;
    float
        *border; /* NULL, or width * height: each pixel's share of the tile that has the second most of it, 0 to 0.5 */
    uint32_t
        *owner; /* NULL, or width * height: the index of the tile that has the most; UINT32_MAX where none has any */
} cn_union_output;
/* Renders a view of several tiles as one. Each ray is marched once. Its density is the sum of the tiles' densities by
 * their part of each place, and its colour is mixed in the same proportion. options->appearance is not read. */
CN_API CN_NODISCARD cn_status cn_render_union(const cn_context *ctx, const cn_union *tiles, const cn_camera *camera,
                                              const cn_view *view, const cn_render_options *options,
                                              const cn_union_output *output);
/* The parts (sum 1) that the n tiles have in a place, on the map. */
CN_API void cn_union_shares(uint32_t n, const cn_union_part *parts, const double xy_m[2], double *share);

/* What the tile took for standing in that photo only (transients, which renders leave out), over the whole photo:
 * premultiplied colour as in the photo, and alpha. picture has any size; its depth is left alone. CN_ERR_USAGE when the
 * tile was not trained on the photo, CN_ERR_DATA when it was trained without transients. */
CN_API CN_NODISCARD cn_status cn_render_transient(const cn_context *ctx, const cn_tile *tile, const char *photo,
                                                  cn_picture *picture);

#ifdef __cplusplus
}
#endif
#endif
