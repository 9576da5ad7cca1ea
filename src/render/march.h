/* Rays marched front to back through one tile, or through several that share space. One tile is the case of one part.
 * Rays go in blocks, one block a task of the pool, and in rounds of a few samples, so that a ray that has become opaque
 * costs nothing behind its surface. */
#ifndef CONURB_RENDER_MARCH_H
#define CONURB_RENDER_MARCH_H
#include "render/batch.h"
#include "render/partition.h"

/* A ray on its way. */
typedef struct cn_march_ray {
    float at, end; /* t of the next sample, and where the ray ends */
    float transmittance, depth, surface;
    float dir[3], map_length;
    size_t pixel;
} cn_march_ray;

/* What a thread holds of one tile: a round of samples, and what its rays have gathered from it. */
typedef struct cn_march_layer {
    cn_batch batch;
    cn_field_acts acts;
    float *share;                                    /* the tile's part of each sample */
    bool begun;                                      /* the conditioning of these rays is filled */
    uint32_t first[CN_BATCH_RAYS], n[CN_BATCH_RAYS]; /* samples of each ray in this round */
    cn_box_ray ray[CN_BATCH_RAYS];
    float near, far[CN_BATCH_RAYS];
    float rgb[CN_BATCH_RAYS][3], weight[CN_BATCH_RAYS];
    float carried[CN_BATCH_RAYS]; /* weight that waits for a colour: each sample alone shows too little */
} cn_march_layer;

/* Scratch of one thread. */
typedef struct cn_march_worker {
    cn_march_layer *layer; /* [n_parts] */
    uint32_t n_rays, n_going, going[CN_BATCH_RAYS];
    cn_march_ray ray[CN_BATCH_RAYS];
    uint64_t n_evaluated; /* samples of the block */
} cn_march_worker;

/* What is rendered. Fields above the line are the caller's to set, by cn_raymarch_init and then one of the two sources
 * of rays. */
typedef struct cn_raymarch {
    const cn_context *ctx;
    const cn_render_options *options;
    float *rgba, *depth; /* [rays][4], [rays]: the result */
    float *border;       /* as cn_render_union has them, or NULL */
    uint32_t *owner;
    bool to_exit; /* march to where a ray leaves the box, if that is farther than the tile's own range */
    /* rays of a picture: [parts] */
    cn_ray_generator *generator;
    uint32_t width, height;
    /* or a list of rays through one tile; n_rays is 0 for a picture */
    size_t n_rays;
    const double (*origin)[3], (*direction)[3];
    /* Renders all blocks in another way than one by one on the pool; false where it cannot. NULL where there is none.
     */
    bool (*other_way)(const struct cn_raymarch *march, size_t blocks);
    /* ---- */
    cn_shading *shading; /* [parts] */
    cn_partition partition;
    uint32_t n_parts, blocks_x;
    bool all_opaque, any_opaque; /* tiles with a background */
    float step, ratio, half_ratio, log_ratio, near, gain;
    cn_march_worker *workers;
} cn_raymarch;

/* parts: 1 to CN_UNION_MAX; origin_m: the camera's place on the map. Caller deinits, also after a failure. */
CN_NODISCARD cn_status cn_raymarch_init(cn_raymarch *march, const cn_context *ctx, const cn_render_options *options,
                                        uint32_t n, const cn_union_part *parts, const double origin_m[2]);
void cn_raymarch_deinit(cn_raymarch *march);
/* CN_ERR_USAGE when the camera does not have the picture's size. */
CN_NODISCARD cn_status cn_raymarch_check(const cn_camera *camera, const cn_picture *picture);
/* Takes the rays of a picture's pixels, and the picture as the result. */
void cn_raymarch_take_picture(cn_raymarch *march, const cn_camera *camera, const cn_view *view, cn_picture *picture);
/* Renders all rays on the pool of ctx: every render of one tile and of several comes through here.
 * CN_ERR_INTERRUPTED when ctx asks to stop, which is looked at once a block. */
CN_NODISCARD cn_status cn_raymarch_run(cn_raymarch *march);
/* ---- one block, for another way ---- */
/* Takes the rays of a block; nothing is gathered yet. */
void cn_march_block_begin(const cn_raymarch *march, cn_march_worker *worker, size_t block);
/* The rays as effects see them; dir is filled. */
cn_effect_rays cn_march_effect_rays(const cn_march_worker *worker, float dir[CN_BATCH_RAYS][3]);
/* What the rays have gathered, with what lies behind them, to the picture. */
void cn_march_block_write(const cn_raymarch *march, cn_march_worker *worker);
#endif
