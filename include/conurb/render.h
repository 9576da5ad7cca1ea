/* conurb/render.h: renders a view of one tile, or of several tiles in one march of each ray. Several threads may
 * render at the same time, each with a pool and a picture of its own. */
#ifndef CONURB_RENDER_H
#define CONURB_RENDER_H
#include "conurb/base.h"
#include "conurb/pose.h"
#include "conurb/tile.h"
#ifdef __cplusplus
extern "C" {
#endif

/* A picture in linear ACEScg, premultiplied by alpha. depth: metres along the ray, by default the median depth; 0 where
 * alpha is 0. */
typedef struct cn_picture {
    uint32_t width, height;
    float *rgba;  /* height * width * 4, rows top down */
    float *depth; /* height * width */
    float fade;   /* 0 to 1: colour and alpha are multiplied by 1 - fade (cn_compose_fade); 0: by nothing */
    bool wraps;   /* of all directions: the last column lies beside the first. For cn_compose_unseen; a picture's owner
                     sets it, and so does a renderer (conurb/renderer.h) */
} cn_picture;
CN_API CN_NODISCARD cn_status cn_picture_init(cn_picture *picture, uint32_t width, uint32_t height); /* zeroed */
CN_API void cn_picture_deinit(cn_picture *picture);

typedef struct cn_render_options {
    double exposure_ev;              /* stops relative to the tile's reference exposure; applied as a gain */
    const cn_appearance *appearance; /* a row of this tile; NULL: the mean of its photos */
    double min_transmittance;        /* a ray stops when its transmittance is below this; default 1e-3 */
    /* > 0: depth is where the ray's transmittance falls to this value; the expected depth where it does not. Default
     * 0.5, the median depth. 0: the expected depth, divided by alpha; haze makes it too small. */
    double depth_left;
    /* NULL, or a counter: the number of samples at which a field was evaluated is added to it, atomically. */
    uint64_t *samples;
    /* NULL, or a box of the map, lowest then highest x, y and z in metres: what lies outside is left out, and the sky
     * too. Borrowed. */
    const double *crop_m;
    /* The depth of a sample is the mean of where in its step the light ends, as if density were the same all through
     * the step, and not the middle of the step: the middle lies half a step too deep where a surface is opaque. Default
     * true. */
    bool fine_depth;
    /* cn_render_rays only: NULL, or [n][2], the part of each ray that is rendered, in metres along it, without the sky.
     * Borrowed. */
    const double (*range_m)[2];
} cn_render_options;
CN_API cn_render_options cn_render_options_default(void);

/* Renders a view of a tile. The caller has allocated the picture; camera has its size. CN_ERR_INTERRUPTED: asked to
 * stop. CN_ERR_NOMEM. */
CN_API CN_NODISCARD cn_status cn_render_tile(const cn_context *ctx, const cn_tile *tile, const cn_camera *camera,
                                             const cn_view *view, const cn_render_options *options,
                                             cn_picture *picture);

/* Renders rays that the caller gives, for example of an orthographic view or straight down for heights. Writes
 * rgba[n][4] (as in cn_picture) and depth_m[n] (along the ray). The caller owns all buffers. Errors as above. */
CN_API CN_NODISCARD cn_status cn_render_rays(const cn_context *ctx, const cn_tile *tile, const cn_ray_list *rays,
                                             const cn_render_options *options, float *rgba, float *depth_m);

/* ---- channels for compositing (AOVs) ---- */
/* What a picture says beside its colour, as bits. What is not asked for is not computed.
 *   depth              metres along the ray, as in cn_picture
 *   normal             x east, y north, z up, unit length, towards the camera: the direction in which density falls
 *                      (of a signed distance the gradient's own); 0 where there is no surface
 *   opacity            alpha of the picture: matter and sky together
 *   ambient_occlusion  part of the hemisphere above the surface that is open within a tenth of the tile's half extent,
 *                      by 8 short rays through the density; 1: open, and where there is no surface
 *   coverage           how many photos that the tile was trained on support the surface: their frustum holds the point,
 *                      and their own depth there (rendered once, 128 pixels wide) does not hide it */
enum {
    CN_AOV_DEPTH = 1,
    CN_AOV_NORMAL = 2,
    CN_AOV_OPACITY = 4,
    CN_AOV_AMBIENT_OCCLUSION = 8,
    CN_AOV_COVERAGE = 16,
    CN_AOV_COUNT = 5
};
/* "depth", "normal", ...: of bit 1 << i; NULL from CN_AOV_COUNT on. Values a pixel: 3 of the normal, else 1. */
CN_API const char *cn_aov_name(unsigned i);
CN_API unsigned cn_aov_channels(unsigned i);
/* "depth,normal" to bits. CN_ERR_USAGE names the one that is unknown, and those that there are. */
CN_API CN_NODISCARD cn_status cn_aov_parse(const char *names, unsigned *aovs);
typedef struct cn_aovs {
    uint32_t width, height;
    float *values[CN_AOV_COUNT]; /* [height][width][channels], rows top down; NULL: not asked for */
} cn_aovs;
/* Zeroed. CN_ERR_NOMEM. */
CN_API CN_NODISCARD cn_status cn_aovs_init(cn_aovs *aovs, uint32_t width, uint32_t height, unsigned which);
CN_API void cn_aovs_deinit(cn_aovs *aovs);

/* ---- a union of overlapping tiles ---- */
/* One tile of a union. A place belongs to the tile with the smallest distance: the horizontal distance to its centre,
 * plus its offset_m. A tile whose distance exceeds the smallest one by less than blend_width_m has a share of the place
 * too. The shares of a place sum to 1. */
typedef struct cn_union_part {
    const cn_tile *tile;
    double centre_m[3];
    double blend_width_m;            /* > 0 */
    double offset_m;                 /* >= 0; INFINITY: the tile owns nothing */
    const cn_appearance *appearance; /* a row of this tile; NULL: the mean of its photos */
} cn_union_part;
enum { CN_UNION_MAX = 16 };
typedef struct cn_union {
    uint32_t n; /* 1 to CN_UNION_MAX */
    const cn_union_part *parts;
} cn_union;
/* What cn_render_union writes. All buffers are the caller's. */
typedef struct cn_union_output {
    cn_picture *picture;
    float *border;   /* NULL, or height * width: per pixel the second largest share, 0 to 0.5 */
    uint32_t *owner; /* NULL, or height * width: per pixel the tile with the largest share; UINT32_MAX: none */
} cn_union_output;
/* Renders a view of several tiles as one field. Each ray is marched once. At each sample the density is the sum of the
 * tiles' densities, weighted by their shares, and colours are mixed in the same proportion. options->appearance is
 * ignored. Errors as above. */
CN_API CN_NODISCARD cn_status cn_render_union(const cn_context *ctx, const cn_union *tiles, const cn_camera *camera,
                                              const cn_view *view, const cn_render_options *options,
                                              const cn_union_output *output);
/* The shares of the n tiles at a place; they sum to 1. */
CN_API void cn_union_shares(uint32_t n, const cn_union_part *parts, const double xy_m[2], double *share);

/* Renders what training took as present in one photo only (people, cars), and left out of the tile. Fills rgba of the
 * picture, of any size, with the premultiplied colour and alpha over the whole photo; depth does not change.
 * CN_ERR_USAGE: the tile was not trained on the photo. CN_ERR_DATA: it was trained without the effect `transient`. */
CN_API CN_NODISCARD cn_status cn_render_transient(const cn_context *ctx, const cn_tile *tile, const char *photo,
                                                  cn_picture *picture);

#ifdef __cplusplus
}
#endif
#endif
