/* CN_OP_TRACE: rays through fields, from their first sample to their end. An item is a block of rays. */
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
} cn_device_field;

/* How rays are marched; members as in the renderer on the processor. */
typedef struct cn_device_march {
    float ratio, step, inv_extent, min_transmittance, depth_left, min_weight;
} cn_device_march;

typedef struct cn_device_ray {
    float origin[3], end, dir[3], unused; /* box units; t in metres */
} cn_device_ray;
/* At the start `at` is the first t, transmittance 1 and the rest 0. */
typedef struct cn_device_state {
    float rgb[3], transmittance, at, depth, surface, weight, carried;
    uint32_t count, unused[2];
} cn_device_state;

enum { CN_TRACE_RAYS = 64 }; /* rays per item; unused ones have end 0 */

/* The operation's batch. */
typedef struct cn_trace {
    cn_device_field field;
    cn_device_march march;
    uint64_t *samples; /* added to at the end; may be NULL */
} cn_trace;

/* The operation's buffers: item i has rays CN_TRACE_RAYS * i on, and of each the columns of its field. */
typedef struct cn_trace_buffers {
    cn_device_ray *rays;
    cn_device_state *states;
    float *columns;
} cn_trace_buffers;
#endif
