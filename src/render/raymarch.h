/* The state of a march through tiles: of the whole render, and of a thread's block of rays. */
#ifndef CONURB_RENDER_RAYMARCH_H
#define CONURB_RENDER_RAYMARCH_H
#include "render/batch.h"
#include "render/partition.h"

/* The state of a ray. */
typedef struct cn_march_ray {
    float at, end; /* t of the next sample, and where the ray ends */
    float transmittance, depth, surface;
    float dir[3], map_length;
    size_t pixel;
} cn_march_ray;

/* A thread's data of one tile: a round of samples, and the sums of its rays. */
typedef struct cn_march_layer {
    cn_batch batch;
    cn_field_acts acts;
    float *share;                                    /* the tile's part of each sample */
    bool begun;                                      /* the conditioning of these rays is filled */
    uint32_t first[CN_BATCH_RAYS], n[CN_BATCH_RAYS]; /* samples of each ray in this round */
    cn_box_ray ray[CN_BATCH_RAYS];
    float near, far[CN_BATCH_RAYS];
    float rgb[CN_BATCH_RAYS][3], weight[CN_BATCH_RAYS];
    float carried[CN_BATCH_RAYS]; /* weight of samples that were too faint for a colour of their own; the next sample
                                     gets it */
} cn_march_layer;

/* Scratch of one thread. */
typedef struct cn_march_worker {
    cn_march_layer *layer; /* [n_parts] */
    uint32_t n_rays, n_going, going[CN_BATCH_RAYS];
    cn_march_ray ray[CN_BATCH_RAYS];
    uint64_t n_evaluated; /* samples of the block */
    bool has_sky;         /* the colours have what lies behind them */
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
    const double (*range)[2]; /* of each ray of the list, or NULL */
    double eye_m[3];          /* of a picture: where the camera is */
    /* ---- */
    cn_shading *shading; /* [parts] */
    cn_partition partition;
    uint32_t n_parts, blocks_x;
    bool all_opaque, any_opaque; /* tiles with a background */
    bool describes_sky;          /* a device that traces draws the backgrounds too */
    float step, ratio, half_ratio, log_ratio, near, gain;
    cn_march_worker *workers;
} cn_raymarch;

/* The rays of a block as effects see them; dir is filled. */
static inline cn_effect_rays cn_march_effect_rays(const cn_march_worker *worker, float dir[CN_BATCH_RAYS][3])
{
    static const uint32_t first_row[CN_BATCH_RAYS];
    for (uint32_t r = 0; r < worker->n_rays; r++)
        memcpy(dir[r], worker->ray[r].dir, sizeof dir[r]);
    return (cn_effect_rays){ worker->n_rays, &dir[0][0], NULL, first_row, NULL };
}
#endif
