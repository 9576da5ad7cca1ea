/* Traces rays through one field or several on a device: operations on whole batches, one compute shader each
 * (shader/NAME.comp), and the loop over them. All data are raw pointers. */
#ifndef CONURB_DEVICE_TRACER_H
#define CONURB_DEVICE_TRACER_H
#include "device/passes.h"
#include "device/trace.h"
#include "device/vulkan.h"

enum {
    CN_TRACER_GEO = 16,    /* geometry features; as in shader/common.glsl */
    CN_TRACER_HEADER = 144 /* words before the lists of rays; likewise */
};

extern const char *const cn_tracer_pass_name[CN_TRACER_PASSES];

typedef struct cn_tracer cn_tracer;
/* Copies the fields to the device, with room for batches of max_rays. CN_ERR_NOMEM, CN_ERR_TOOL: the device cannot
 * hold or run them. */
CN_NODISCARD cn_status cn_tracer_create(cn_vulkan *device, const cn_trace *trace, uint32_t max_rays,
                                        cn_tracer **tracer);
void cn_tracer_destroy(cn_tracer **tracer);
/* Bytes on the device of such a tracer. */
uint64_t cn_tracer_bytes(const cn_trace *trace, uint32_t max_rays);
/* Samples of a ray in one round, at most: what stands at one t is in one round. */
uint32_t cn_tracer_round(const cn_trace *trace);

/* A batch: n rays from their first t to their end. The arrays are those of cn_trace_buffers. */
typedef struct cn_device_batch {
    uint32_t n;
    const cn_device_ray *rays;
    const float *columns;
    cn_device_state *states;
    cn_device_sum *sums;
} cn_device_batch;
/* Traces all rays to their end; adds to *samples. CN_ERR_INTERRUPTED: asked to stop. */
CN_NODISCARD cn_status cn_tracer_run(cn_tracer *tracer, const cn_context *ctx, const cn_device_march *march,
                                     const cn_device_batch *batch, uint64_t *samples);

/* Evaluates the density network of the first part at the places of the query. CN_ERR_INTERRUPTED: asked to stop. */
CN_NODISCARD cn_status cn_tracer_query(cn_tracer *tracer, const cn_context *ctx, const cn_density_query *query);

/* For the tests of single operations: sends a batch, runs one operation (of each part, where it is done part by part),
 * reads and writes buffers. */
CN_NODISCARD cn_status cn_tracer_send(cn_tracer *tracer, const cn_device_march *march, const cn_device_batch *batch);
CN_NODISCARD cn_status cn_tracer_run_pass(cn_tracer *tracer, cn_tracer_pass op, uint32_t phase);
CN_NODISCARD cn_status cn_tracer_read(cn_tracer *tracer, cn_tracer_buffer buffer, void *data, size_t size);
CN_NODISCARD cn_status cn_tracer_write(cn_tracer *tracer, cn_tracer_buffer buffer, const void *data, size_t size);
#endif
