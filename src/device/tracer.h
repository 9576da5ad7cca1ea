/* Rays through one field on a device: whole-batch operations, one compute shader each (shader/NAME.comp), and the loop
 * over them. All of it is described by raw pointers. */
#ifndef CONURB_DEVICE_TRACER_H
#define CONURB_DEVICE_TRACER_H
#include "conurb/device.h"
#include "device/ops.h"
#include "kernel/kernel.h"

enum {
    CN_TRACER_ROUND = 8,  /* samples of a ray in one round, at most; as in shader/common.glsl */
    CN_TRACER_GEO = 16,   /* geometry features; likewise */
    CN_TRACER_HEADER = 20 /* words before the lists of rays; likewise */
};

/* A field: hash grid, density network of one hidden layer, colour network of two; layers [in][out], in that order. */
typedef struct cn_device_field {
    const cn_level *level;
    uint32_t levels, enc_rows, density_width, colour_width, columns;
    bool softplus; /* of the density logit; else exp */
    const uint32_t *table;
    size_t entries;
    const float *weights;
    size_t n_weights;
    const uint32_t *occupancy; /* as cn_kernel's march has it */
} cn_device_field;

/* How rays are marched; members as in the renderer on the processor. */
typedef struct cn_device_march {
    float ratio, step, inv_extent, min_transmittance, depth_left, min_weight;
} cn_device_march;

typedef struct cn_device_ray {
    float origin[3], end, dir[3], unused; /* box units; t in metres */
} cn_device_ray;
/* The caller sets `at` to the first t, transmittance to 1 and the rest to 0. */
typedef struct cn_device_state {
    float rgb[3], transmittance, at, depth, surface, weight, carried;
    uint32_t count, unused[2];
} cn_device_state;

extern const char *const cn_device_op_name[CN_DEVICE_OPS];

typedef struct cn_tracer cn_tracer;
/* Copies the field to the device, with room for batches of max_rays. CN_ERR_NOMEM or CN_ERR_TOOL where the device
 * cannot hold or run it. */
CN_NODISCARD cn_status cn_tracer_create(cn_device *device, const cn_device_field *field, uint32_t max_rays,
                                        cn_tracer **tracer);
void cn_tracer_destroy(cn_tracer **tracer);
/* Bytes on the device of such a tracer. */
uint64_t cn_tracer_bytes(const cn_device_field *field, uint32_t max_rays);

/* A batch: n rays from first_t to their end. columns[n][field.columns]. */
typedef struct cn_device_batch {
    uint32_t n;
    const cn_device_ray *rays;
    const float *columns;
    cn_device_state *states;
} cn_device_batch;
/* Takes all rays to their end; *samples is added to. CN_ERR_INTERRUPTED when ctx asks to stop. */
CN_NODISCARD cn_status cn_tracer_run(cn_tracer *tracer, const cn_context *ctx, const cn_device_march *march,
                                     const cn_device_batch *batch, uint64_t *samples);

/* True the first time: for a line of the log that need not come again. */
bool cn_device_say_once(cn_device *device);

/* For the tests of single operations: sends a batch, runs one operation, reads and writes buffers. */
CN_NODISCARD cn_status cn_tracer_send(cn_tracer *tracer, const cn_device_march *march, const cn_device_batch *batch);
CN_NODISCARD cn_status cn_tracer_op(cn_tracer *tracer, cn_device_op op, uint32_t phase);
CN_NODISCARD cn_status cn_tracer_read(cn_tracer *tracer, cn_tracer_buffer buffer, void *data, size_t size);
CN_NODISCARD cn_status cn_tracer_write(cn_tracer *tracer, cn_tracer_buffer buffer, const void *data, size_t size);
#endif
