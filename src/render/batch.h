/* Samples of a block of rays in one tile, evaluated together. */
#ifndef CONURB_RENDER_BATCH_H
#define CONURB_RENDER_BATCH_H
#include "device/device.h"
#include "tile/model.h"

enum {
    CN_BATCH_RAYS = 64,
    CN_BATCH_ROUND = 6, /* samples of a ray in one round, at most; of 12, one in five was behind the surface */
    CN_BATCH_CAP = CN_BATCH_RAYS * CN_BATCH_ROUND, /* 8 panels */
    CN_BATCH_PANELS =
        CN_BATCH_CAP / CN_PANEL + 1 /* of what is visible: of a round, and less than a panel of those before */
};
#define CN_BATCH_MIN_WEIGHT 5e-4f /* a sample with less weight gets no colour evaluation of its own */

/* A tile with one appearance. It has pointers into itself, so it must not be moved. */
typedef struct cn_shading {
    const cn_tile *tile;
    const cn_kernel *kernel;
    const cn_effect_pack *pack; /* of one row */
    cn_appearance row;
    cn_effect_state effects;
    float inv_extent;
} cn_shading;
/* row NULL: the mean. CN_ERR_USAGE for a row of another tile. */
CN_NODISCARD cn_status cn_shading_init(cn_shading *shading, const cn_context *ctx, const cn_tile *tile,
                                       const cn_appearance *row);

/* The samples of one round. The caller fills t_at, pos and length of n_samples, and adds those that are visible by
 * cn_batch_show. Colours may wait for those of later rounds: a full panel costs as much as a panel of one sample. */
typedef struct cn_batch {
    float *pos, *length, *t_at; /* as the kernel's place makes them; [CN_BATCH_CAP] */
    float *geo;                 /* [panels][geo_rows][CN_PANEL] */
    float *in;                  /* of the visible samples: the colour head's input, [panels][rows][CN_PANEL] */
    float *weight;
    uint32_t *live_ray;  /* the ray of each visible sample */
    float *conditioning; /* a row a ray: the effects' input of the colour head */
    float *saved;        /* the effects' saved activations */
    uint32_t n_samples, n_live, rows, geo_rows;
    cn_density_activation density;
} cn_batch;
void cn_batch_take(const cn_tile *tile, cn_arena *arena, cn_batch *batch);
/* Begins a block of rays: fills their conditioning. */
void cn_batch_condition(const cn_shading *shading, cn_batch *batch, const cn_effect_rays *rays);
/* Geometry features of the samples. acts: scratch with room for this tile. */
void cn_batch_density(const cn_shading *shading, cn_batch *batch, const cn_field_acts *acts);
/* Adds a sample of the round to those that need a colour. weight: its part of the ray's colour. */
void cn_batch_show(cn_batch *batch, uint32_t sample, uint32_t ray, float weight);
/* Adds weight * colour of the visible samples to rgb[their ray]: of full panels, or of all at the end of the block. */
void cn_batch_colour(const cn_shading *shading, cn_batch *batch, const cn_field_acts *acts, bool all, float (*rgb)[3]);
/* The optical depth of sample i. */
float cn_batch_depth(const cn_batch *batch, uint32_t i);
#endif
