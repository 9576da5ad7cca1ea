/* The operations of a tracer, and the buffers that they share. */
#ifndef CONURB_DEVICE_OPS_H
#define CONURB_DEVICE_OPS_H

typedef enum cn_device_op {
    CN_OP_BEGIN,
    CN_OP_MARCH,
    CN_OP_ENCODE,
    CN_OP_DENSITY,
    CN_OP_COMPOSITE,
    CN_OP_COLOUR,
    CN_OP_GATHER,
    CN_DEVICE_OPS
} cn_device_op;

/* In the order of their bindings; shader/common.glsl has the layouts. */
typedef enum cn_tracer_buffer {
    CN_TRACER_TABLE,
    CN_TRACER_WEIGHTS,
    CN_TRACER_OCCUPANCY,
    CN_TRACER_LEVELS,
    CN_TRACER_RAYS,
    CN_TRACER_COLUMNS,
    CN_TRACER_STATES,
    CN_TRACER_GOING,
    CN_TRACER_T,
    CN_TRACER_PLACES,
    CN_TRACER_ENCODINGS,
    CN_TRACER_FEATURES,
    CN_TRACER_VISIBLE,
    CN_TRACER_COLOURS,
    CN_TRACER_BUFFERS
} cn_tracer_buffer;
#endif
