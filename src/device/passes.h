/* The operations of a tracer, and the buffers that they share. */
#ifndef CONURB_DEVICE_PASSES_H
#define CONURB_DEVICE_PASSES_H

typedef enum cn_tracer_pass {
    CN_PASS_BEGIN,
    CN_PASS_MARCH,
    CN_PASS_ENCODE,
    CN_PASS_DENSITY,
    CN_PASS_COMPOSITE,
    CN_PASS_COLOUR,
    CN_PASS_GATHER,
    CN_PASS_SKY,
    CN_TRACER_PASSES
} cn_tracer_pass;

/* Buffers in the order of their bindings; shader/common.glsl has the layouts. */
typedef enum cn_tracer_buffer {
    CN_TRACER_TABLE,
    CN_TRACER_WEIGHTS,
    CN_TRACER_OCCUPANCY,
    CN_TRACER_PARTS,
    CN_TRACER_RAYS,
    CN_TRACER_COLUMNS,
    CN_TRACER_STATES,
    CN_TRACER_SUMS,
    CN_TRACER_GOING,
    CN_TRACER_SAMPLES,
    CN_TRACER_PLACES,
    CN_TRACER_ENCODINGS,
    CN_TRACER_FEATURES,
    CN_TRACER_VISIBLE,
    CN_TRACER_COLOURS,
    CN_TRACER_BUFFERS
} cn_tracer_buffer;
#endif
