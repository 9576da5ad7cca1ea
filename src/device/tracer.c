#include "device/tracer.h"

#include "device/pipeline.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

enum { ROUNDS = 8 /* rounds between two checks of the number of rays left */, MAX_LANES = 64, WEIGHTS_PAST_END = 16 };

const char *const cn_tracer_pass_name[CN_TRACER_PASSES] = { "begin",     "march",  "encode", "density",
                                                            "composite", "colour", "gather" };

struct cn_tracer {
    cn_device_stream stream;
    cn_tracer_pipelines pipelines;
    cn_tracer_push push;
    cn_device_buffer buffer[CN_TRACER_BUFFERS];
};

/* The header of the buffer Going, before its lists. */
typedef struct header {
    uint32_t n_in, n_out, n_visible, n_samples;
    uint32_t groups[4][4]; /* of dispatches: rays, samples and levels, samples, visible samples */
} header;
_Static_assert(sizeof(header) == CN_TRACER_HEADER * sizeof(uint32_t), "as in the shaders");
_Static_assert(sizeof(cn_device_ray) == 32 && sizeof(cn_device_state) == 48, "as in the shaders");

static uint32_t most_rows(const cn_device_field *f)
{
    const uint32_t rows[] = { f->enc_rows, f->density_width, f->colour_width, CN_TRACER_GEO + f->columns };
    uint32_t most = 0;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        if (rows[i] > most) most = rows[i];
    return most;
}

static void sizes(const cn_device_field *f, uint32_t max_rays, size_t size[CN_TRACER_BUFFERS])
{
    const size_t slots = (size_t)max_rays * CN_TRACER_ROUND, word = sizeof(uint32_t);
    size[CN_TRACER_TABLE] = f->entries * word;
    size[CN_TRACER_WEIGHTS] = (f->n_weights + WEIGHTS_PAST_END) * word;
    size[CN_TRACER_OCCUPANCY] = CN_OCC_CELLS / 8;
    size[CN_TRACER_LEVELS] = f->levels * 4 * word;
    size[CN_TRACER_RAYS] = max_rays * sizeof(cn_device_ray);
    size[CN_TRACER_COLUMNS] = (size_t)max_rays * (f->columns ? f->columns : 1) * word;
    size[CN_TRACER_STATES] = max_rays * sizeof(cn_device_state);
    size[CN_TRACER_GOING] = sizeof(header) + 2 * (size_t)max_rays * word;
    size[CN_TRACER_T] = size[CN_TRACER_VISIBLE] = slots * word;
    size[CN_TRACER_PLACES] = size[CN_TRACER_COLOURS] = slots * 4 * word;
    size[CN_TRACER_ENCODINGS] = slots * 2 * f->levels * word;
    size[CN_TRACER_FEATURES] = slots * CN_TRACER_GEO * word;
}

uint64_t cn_tracer_bytes(const cn_device_field *field, uint32_t max_rays)
{
    size_t size[CN_TRACER_BUFFERS];
    uint64_t sum = 0;
    sizes(field, max_rays, size);
    for (int i = 0; i < CN_TRACER_BUFFERS; i++)
        sum += size[i];
    return sum;
}

static cn_status send_field(cn_tracer *t, const cn_device_field *f)
{
    const float zero[WEIGHTS_PAST_END] = { 0 };
    uint32_t level[CN_MAX_LEVELS][4];
    for (uint32_t l = 0; l < f->levels; l++) {
        const uint32_t row[4] = { f->level[l].resolution, f->level[l].entries, f->level[l].offset, f->level[l].hashed };
        memcpy(level[l], row, sizeof row);
    }
    CN_TRY(cn_tracer_write(t, CN_TRACER_TABLE, f->table, f->entries * sizeof *f->table));
    CN_TRY(cn_tracer_write(t, CN_TRACER_WEIGHTS, f->weights, f->n_weights * sizeof *f->weights));
    CN_TRY(
        cn_device_put(&t->stream, &t->buffer[CN_TRACER_WEIGHTS], f->n_weights * sizeof *f->weights, zero, sizeof zero));
    CN_TRY(cn_tracer_write(t, CN_TRACER_OCCUPANCY, f->occupancy, CN_OCC_CELLS / 8));
    return cn_tracer_write(t, CN_TRACER_LEVELS, level, f->levels * sizeof *level);
}

/* Threads per group, so that two layers of activations for each thread fit into shared memory; 0 when not even 8 do. */
static uint32_t lanes(cn_vulkan *device, uint32_t rows)
{
    uint32_t n = MAX_LANES;
    while (n >= 8 && (uint64_t)2 * n * rows * sizeof(float) > device->properties.limits.maxComputeSharedMemorySize)
        n /= 2;
    return n >= 8 ? n : 0;
}

static cn_status build(cn_tracer *t, cn_vulkan *device, const cn_device_field *f, uint32_t max_rays)
{
    size_t size[CN_TRACER_BUFFERS];
    const uint32_t rows = most_rows(f);
    t->push = (cn_tracer_push){ .max_rays = max_rays,
                                .levels = f->levels,
                                .enc_rows = f->enc_rows,
                                .density_width = f->density_width,
                                .colour_width = f->colour_width,
                                .columns = f->columns,
                                .lanes = lanes(device, rows),
                                .softplus = f->softplus };
    if (!t->push.lanes)
        return cn_fail(CN_ERR_TOOL, "%s has too little shared memory for a network of width %u", device->base.info.name,
                       rows);
    if (cn_tracer_bytes(f, max_rays) > device->base.info.bytes)
        return cn_fail(CN_ERR_NOMEM, "%s has %.1f GB; the tile and its rays need %.1f GB", device->base.info.name,
                       (double)device->base.info.bytes / 1e9, (double)cn_tracer_bytes(f, max_rays) / 1e9);
    CN_TRY(cn_device_stream_create(device, true, &t->stream));
    sizes(f, max_rays, size);
    for (int i = 0; i < CN_TRACER_BUFFERS; i++)
        CN_TRY(cn_device_buffer_create(device, size[i], false, &t->buffer[i]));
    CN_TRY(cn_tracer_pipelines_create(device, t->push.lanes, rows, t->buffer, &t->pipelines));
    return send_field(t, f);
}

cn_status cn_tracer_create(cn_vulkan *device, const cn_device_field *field, uint32_t max_rays, cn_tracer **tracer)
{
    cn_tracer *t = *tracer = calloc(1, sizeof *t);
    if (!t) return cn_fail(CN_ERR_NOMEM, "out of memory");
    t->stream.device = device;
    const cn_status status = build(t, device, field, max_rays);
    if (status != CN_OK) cn_tracer_destroy(tracer);
    return status;
}

void cn_tracer_destroy(cn_tracer **tracer)
{
    cn_tracer *t = *tracer;
    if (!t) return;
    cn_vulkan *device = t->stream.device;
    cn_tracer_pipelines_destroy(device, &t->pipelines);
    for (int i = 0; i < CN_TRACER_BUFFERS; i++)
        cn_device_buffer_destroy(device, &t->buffer[i]);
    cn_device_stream_destroy(&t->stream);
    free(t);
    *tracer = NULL;
}

cn_status cn_tracer_read(cn_tracer *t, cn_tracer_buffer buffer, void *data, size_t size)
{
    return cn_device_get(&t->stream, &t->buffer[buffer], 0, data, size);
}

cn_status cn_tracer_write(cn_tracer *t, cn_tracer_buffer buffer, const void *data, size_t size)
{
    return cn_device_put(&t->stream, &t->buffer[buffer], 0, data, size);
}

cn_status cn_tracer_send(cn_tracer *t, const cn_device_march *march, const cn_device_batch *batch)
{
    const uint32_t n = batch->n;
    const header start = { .n_out = n };
    t->push.ratio = march->ratio;
    t->push.step = march->step;
    t->push.inv_extent = march->inv_extent;
    t->push.min_transmittance = march->min_transmittance;
    t->push.depth_left = march->depth_left;
    t->push.min_weight = march->min_weight;
    t->push.parity = 0;
    uint32_t *list = malloc((n ? n : 1) * sizeof *list);
    if (!list) return cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < n; i++)
        list[i] = i;
    cn_status status = cn_device_put(&t->stream, &t->buffer[CN_TRACER_GOING], sizeof start, list, n * sizeof *list);
    free(list);
    if (status == CN_OK) status = cn_tracer_write(t, CN_TRACER_GOING, &start, sizeof start);
    if (status == CN_OK) status = cn_tracer_write(t, CN_TRACER_RAYS, batch->rays, n * sizeof *batch->rays);
    if (status == CN_OK) status = cn_tracer_write(t, CN_TRACER_STATES, batch->states, n * sizeof *batch->states);
    const size_t columns = (size_t)n * t->push.columns * sizeof(float);
    if (status == CN_OK && columns) status = cn_tracer_write(t, CN_TRACER_COLUMNS, batch->columns, columns);
    return status;
}

/* Records one operation, and a barrier for what it writes. */
static void record(cn_tracer *t, cn_tracer_pass op, uint32_t phase)
{
    static const int groups[CN_TRACER_PASSES] = {
        [CN_PASS_BEGIN] = -1,    [CN_PASS_MARCH] = 0,  [CN_PASS_ENCODE] = 1, [CN_PASS_DENSITY] = 2,
        [CN_PASS_COMPOSITE] = 0, [CN_PASS_COLOUR] = 3, [CN_PASS_GATHER] = 0,
    };
    const cn_vulkan *d = t->stream.device;
    VkCommandBuffer to = t->stream.commands;
    t->push.phase = phase;
    d->CmdBindPipeline(to, VK_PIPELINE_BIND_POINT_COMPUTE, t->pipelines.op[op]);
    d->CmdBindDescriptorSets(to, VK_PIPELINE_BIND_POINT_COMPUTE, t->pipelines.layout, 0, 1, &t->pipelines.set, 0, NULL);
    d->CmdPushConstants(to, t->pipelines.layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof t->push, &t->push);
    if (groups[op] < 0)
        d->CmdDispatch(to, 1, 1, 1);
    else
        d->CmdDispatchIndirect(to, t->buffer[CN_TRACER_GOING].handle,
                               offsetof(header, groups) + (size_t)groups[op] * 4 * sizeof(uint32_t));
    cn_device_stream_barrier(&t->stream);
}

static void record_round(cn_tracer *t)
{
    record(t, CN_PASS_BEGIN, 0);
    record(t, CN_PASS_MARCH, 0);
    record(t, CN_PASS_ENCODE, 0);
    record(t, CN_PASS_DENSITY, 0);
    record(t, CN_PASS_COMPOSITE, 0);
    record(t, CN_PASS_BEGIN, 1);
    record(t, CN_PASS_COLOUR, 0);
    record(t, CN_PASS_GATHER, 0);
    t->push.parity ^= 1;
}

cn_status cn_tracer_run_pass(cn_tracer *t, cn_tracer_pass op, uint32_t phase)
{
    CN_TRY(cn_device_stream_begin(&t->stream));
    record(t, op, phase);
    return cn_device_stream_finish(&t->stream);
}

cn_status cn_tracer_run(cn_tracer *t, const cn_context *ctx, const cn_device_march *march, const cn_device_batch *batch,
                        uint64_t *samples)
{
    header now = { .n_out = batch->n };
    CN_TRY(cn_tracer_send(t, march, batch));
    while (now.n_out) {
        if (cn_stopping(ctx))
            return cn_fail(CN_ERR_INTERRUPTED, "stopped while rendering; run the same command to resume");
        CN_TRY(cn_device_stream_begin(&t->stream));
        for (int i = 0; i < ROUNDS; i++)
            record_round(t);
        CN_TRY(cn_device_stream_finish(&t->stream));
        CN_TRY(cn_tracer_read(t, CN_TRACER_GOING, &now, sizeof now));
    }
    *samples += now.n_samples;
    return cn_tracer_read(t, CN_TRACER_STATES, batch->states, batch->n * sizeof *batch->states);
}
