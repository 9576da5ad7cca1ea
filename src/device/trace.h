/* CN_OP_TRACE: rays through fields, from their first sample to their end. An item is a block of rays.
 * CN_OP_DENSITY: what a field's density network says of places. Other devices do all items at once, without pack and
 * unpack. */
#ifndef CONURB_DEVICE_TRACE_H
#define CONURB_DEVICE_TRACE_H
#include "kernel/kernel.h"

/* A field: hash grid, density network of one hidden layer, colour network of two; layers [in][out], in that order. */
typedef struct cn_device_field {
    const cn_level *level;
    uint32_t levels, enc_rows, density_width, colour_width, columns;
    bool softplus; /* density activation softplus; else exp */
    const uint32_t *table;
    size_t entries;
    const float *weights;
    size_t n_weights;
    const uint32_t *occupancy; /* as in cn_kernel.march */
    uint64_t serial;           /* equal for fields of equal content, which a device may keep; 0: it keeps none */
} cn_device_field;

/* What lies behind a part: the sky of src/effect/sky.c. weights NULL: nothing. */
enum {
    CN_DEVICE_SKY_IN = 16,
    CN_DEVICE_SKY_WIDTH = 32,
    CN_DEVICE_SKY_OUT = 4,
    CN_DEVICE_SKY_WEIGHTS = CN_DEVICE_SKY_WIDTH * (CN_DEVICE_SKY_IN + CN_DEVICE_SKY_WIDTH + CN_DEVICE_SKY_OUT),
    CN_DEVICE_SKY_CODE = 12
};
typedef struct cn_device_sky {
    const float *weights; /* [CN_DEVICE_SKY_WEIGHTS]: layers [in][out] */
    const float *code;    /* [CN_DEVICE_SKY_CODE]: a colour and its slopes along the axes */
} cn_device_sky;

/* A field of the march, and its place among the others: x and y of its centre relative to the rays' origin, blend width
 * and offset, all in metres, as in cn_union_part. With a single field its share is 1 everywhere. */
typedef struct cn_device_part {
    cn_device_field field;
    cn_device_sky sky;
    float inv_extent, x, y, blend_width, offset;
} cn_device_part;

/* How rays are marched; members as in the renderer on the processor. */
typedef struct cn_device_march {
    float ratio, step, min_transmittance, depth_left, min_weight;
    bool fine_depth;
    bool sky; /* adds the skies at the end of each ray, where it ends */
} cn_device_march;

/* A ray in the box of one part: samples of that part lie from begin to end. Box units; t in metres. */
typedef struct cn_device_ray {
    float origin[3], end, dir[3], begin;
} cn_device_ray;
/* A ray's march through all parts. At the start `at` is the first t, `end` the last, transmittance 1, `dir` the
 * direction (east, north, up), and the rest 0. */
typedef struct cn_device_state {
    float transmittance, at, depth, surface, end, dir[3];
    uint32_t count, unused[3];
} cn_device_state;
/* What a ray shows of one part; 0 at the start. */
typedef struct cn_device_sum {
    float rgb[3], weight, carried;
    uint32_t unused[3];
} cn_device_sum;

enum {
    CN_TRACE_RAYS = 64, /* rays per item; unused ones have end 0 */
    CN_TRACE_PARTS = 16 /* fields of one march, at most; as in shader/common.glsl */
};

/* The operation's batch. */
typedef struct cn_trace {
    uint32_t n_parts;
    cn_device_part part[CN_TRACE_PARTS];
    cn_device_march march;
    uint64_t *samples; /* added to at the end; may be NULL */
} cn_trace;
/* Columns of a ray: those of all fields, one after the other. */
static inline uint32_t cn_trace_columns(const cn_trace *trace)
{
    uint32_t n = 0;
    for (uint32_t p = 0; p < trace->n_parts; p++)
        n += trace->part[p].field.columns;
    return n;
}

/* The operation's buffers: item i has rays CN_TRACE_RAYS * i on. */
typedef struct cn_trace_buffers {
    cn_device_ray *rays; /* [ray][part] */
    cn_device_state *states;
    cn_device_sum *sums; /* [ray][part] */
    float *columns;      /* [ray][columns] */
} cn_trace_buffers;

/* The batch of CN_OP_DENSITY. */
typedef struct cn_density_query {
    cn_device_field field;
    size_t n;
    const float (*place)[4]; /* [n]: the contracted position, 0 to 1; the fourth is not used */
    float *logit;            /* [n]: the result, before the density activation */
} cn_density_query;
#endif
