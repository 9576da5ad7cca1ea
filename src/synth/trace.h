/* Rays against patches, by Embree. Nothing else includes its headers. */
#ifndef CONURB_SYNTH_TRACE_H
#define CONURB_SYNTH_TRACE_H
#include "synth/mesh.h"

typedef struct cn_device cn_device;
typedef struct cn_tracer cn_tracer;
/* t along the ray, and the place on the patch, worked out again in double from the patch's own numbers. */
typedef struct cn_hit {
    uint32_t patch;
    float a, b;
    double t;
} cn_hit;

CN_NODISCARD cn_status cn_device_create(cn_device **device);
void cn_device_destroy(cn_device **device);
/* The mesh must outlive the tracer. Different threads may create tracers on one device at once. */
CN_NODISCARD cn_status cn_tracer_create(cn_tracer **tracer, cn_device *device, const cn_mesh *mesh);
void cn_tracer_destroy(cn_tracer **tracer);
/* Both for any thread. direction need not be of unit length; t is in its unit. */
bool cn_tracer_hit(const cn_tracer *tracer, const double origin[3], const double direction[3], double far, cn_hit *hit);
bool cn_tracer_blocked(const cn_tracer *tracer, const double origin[3], const double direction[3], double far);
#endif
