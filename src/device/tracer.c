#include "device/tracer.h"

#include "device/store.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

enum {
    ROUNDS = 8, /* rounds between two checks of the number of rays left */
    FULL_ROUND = 8,
    MAX_LANES = 64,
    OCCUPANCY_BYTES = CN_OCC_CELLS / 8
};

const char *const cn_tracer_pass_name[CN_TRACER_PASSES] = { "begin",     "march",  "encode", "density",
                                                            "composite", "colour", "gather", "sky" };

struct cn_tracer {
    cn_device_stream stream;
    const cn_tracer_pipelines *pipelines;
    cn_tracer_bindings bindings;
    cn_tracer_push push;
    cn_device_buffer buffer[CN_TRACER_BUFFERS]; /* without tables and weights */
    cn_stored_field *field[CN_TRACE_PARTS];
};

/* The header of the buffer Going, before its lists. */
typedef struct header {
    uint32_t n_in, n_out, n_visible, n_samples;
    uint32_t groups_ray[4], groups_visible[4];
    uint32_t present, unused[3];
    uint32_t groups_level[CN_TRACE_PARTS][4], groups_sample[CN_TRACE_PARTS][4];
} header;
_Static_assert(sizeof(header) == CN_TRACER_HEADER * sizeof(uint32_t), "as in the shaders");
_Static_assert(sizeof(cn_device_ray) == 32 && sizeof(cn_device_state) == 48 && sizeof(cn_device_sum) == 32,
               "as in the shaders");

/* A part as the shaders have it. */
typedef struct part {
    float x, y, blend_width, offset, inv_extent;
    uint32_t softplus, levels, enc_rows, density_width, colour_width, columns, column_at;
    uint32_t level[CN_MAX_LEVELS][4];
    uint32_t has_sky, unused[3];
    float sky_code[CN_DEVICE_SKY_CODE], sky[CN_DEVICE_SKY_WEIGHTS];
} part;
_Static_assert(sizeof(part) == 64 + 16 * 24 + 4 * (12 + 1664), "as in the shaders");

uint32_t cn_tracer_round(const cn_trace *trace)
{
    return trace->n_parts > FULL_ROUND ? trace->n_parts : FULL_ROUND;
}

static uint32_t most_rows(const cn_trace *trace)
{
    uint32_t most = 0;
    for (uint32_t p = 0; p < trace->n_parts; p++) {
        const cn_device_field *f = &trace->part[p].field;
        const uint32_t rows[] = { f->enc_rows, f->density_width, f->colour_width, CN_TRACER_GEO + f->columns };
        for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
            if (rows[i] > most) most = rows[i];
    }
    return most;
}

static uint32_t most_levels(const cn_trace *trace)
{
    uint32_t most = 0;
    for (uint32_t p = 0; p < trace->n_parts; p++)
        if (trace->part[p].field.levels > most) most = trace->part[p].field.levels;
    return most;
}

/* Table and weights are of a part, and have size 0 here. */
static void sizes(const cn_trace *trace, uint32_t max_rays, size_t size[CN_TRACER_BUFFERS])
{
    const size_t slots = (size_t)max_rays * cn_tracer_round(trace), word = sizeof(uint32_t), n = trace->n_parts;
    const uint32_t columns = cn_trace_columns(trace);
    size[CN_TRACER_TABLE] = size[CN_TRACER_WEIGHTS] = 0;
    size[CN_TRACER_OCCUPANCY] = n * OCCUPANCY_BYTES;
    size[CN_TRACER_PARTS] = n * sizeof(part);
    size[CN_TRACER_RAYS] = n * max_rays * sizeof(cn_device_ray);
    size[CN_TRACER_COLUMNS] = (size_t)max_rays * (columns ? columns : 1) * word;
    size[CN_TRACER_STATES] = max_rays * sizeof(cn_device_state);
    size[CN_TRACER_SUMS] = n * max_rays * sizeof(cn_device_sum);
    size[CN_TRACER_GOING] = sizeof(header) + 2 * (size_t)max_rays * word;
    size[CN_TRACER_SAMPLES] = slots * 2 * word;
    size[CN_TRACER_VISIBLE] = slots * word;
    size[CN_TRACER_PLACES] = size[CN_TRACER_COLOURS] = slots * 4 * word;
    size[CN_TRACER_ENCODINGS] = slots * 2 * most_levels(trace) * word;
    size[CN_TRACER_FEATURES] = slots * CN_TRACER_GEO * word;
}

uint64_t cn_tracer_bytes(const cn_trace *trace, uint32_t max_rays)
{
    size_t size[CN_TRACER_BUFFERS];
    uint64_t sum = 0;
    sizes(trace, max_rays, size);
    for (int i = 0; i < CN_TRACER_BUFFERS; i++)
        sum += size[i];
    for (uint32_t p = 0; p < trace->n_parts; p++)
        sum += cn_tracer_store_bytes(&trace->part[p].field);
    return sum;
}

static void describe(const cn_device_part *from, uint32_t column_at, part *to)
{
    const cn_device_field *f = &from->field;
    *to = (part){ .x = from->x,
                  .y = from->y,
                  .blend_width = from->blend_width,
                  .offset = from->offset,
                  .inv_extent = from->inv_extent,
                  .softplus = f->softplus,
                  .levels = f->levels,
                  .enc_rows = f->enc_rows,
                  .density_width = f->density_width,
                  .colour_width = f->colour_width,
                  .columns = f->columns,
                  .column_at = column_at };
    for (uint32_t l = 0; l < f->levels; l++) {
        const uint32_t row[4] = { f->level[l].resolution, f->level[l].entries, f->level[l].offset, f->level[l].hashed };
        memcpy(to->level[l], row, sizeof row);
    }
    if (!from->sky.weights) return;
    to->has_sky = 1;
    memcpy(to->sky, from->sky.weights, sizeof to->sky);
    memcpy(to->sky_code, from->sky.code, sizeof to->sky_code);
}

static cn_status send_parts(cn_tracer *t, const cn_trace *trace)
{
    part described;
    uint32_t columns = 0;
    for (uint32_t p = 0; p < trace->n_parts; p++) {
        describe(&trace->part[p], columns, &described);
        columns += trace->part[p].field.columns;
        CN_TRY(
            cn_device_put(&t->stream, &t->buffer[CN_TRACER_PARTS], p * sizeof described, &described, sizeof described));
        CN_TRY(cn_tracer_store_field(&t->stream, &trace->part[p].field, &t->field[p]));
        CN_TRY(cn_device_put(&t->stream, &t->buffer[CN_TRACER_OCCUPANCY], p * (size_t)OCCUPANCY_BYTES,
                             trace->part[p].field.occupancy, OCCUPANCY_BYTES));
    }
    return CN_OK;
}

static cn_status bind(cn_tracer *t)
{
    cn_vulkan *device = t->stream.device;
    cn_device_buffer of_part[CN_TRACER_BUFFERS];
    CN_TRY(cn_tracer_bindings_create(device, t->pipelines, t->push.parts, &t->bindings));
    memcpy(of_part, t->buffer, sizeof of_part);
    for (uint32_t p = 0; p < t->push.parts; p++) {
        of_part[CN_TRACER_TABLE] = t->field[p]->table;
        of_part[CN_TRACER_WEIGHTS] = t->field[p]->weights;
        cn_tracer_bindings_set(device, &t->bindings, p, of_part);
    }
    return CN_OK;
}

/* Threads per group, so that two layers of activations for each thread fit into shared memory; 0 when not even 8 do. */
static uint32_t lanes(cn_vulkan *device, uint32_t rows)
{
    uint32_t n = MAX_LANES;
    while (n >= 8 && (uint64_t)2 * n * rows * sizeof(float) > device->properties.limits.maxComputeSharedMemorySize)
        n /= 2;
    return n >= 8 ? n : 0;
}

static cn_status build(cn_tracer *t, cn_vulkan *device, const cn_trace *trace, uint32_t max_rays)
{
    size_t size[CN_TRACER_BUFFERS];
    const uint32_t rows = most_rows(trace);
    t->push = (cn_tracer_push){ .max_rays = max_rays,
                                .parts = trace->n_parts,
                                .levels = most_levels(trace),
                                .columns = cn_trace_columns(trace),
                                .lanes = lanes(device, rows) };
    if (!t->push.lanes)
        return cn_fail(CN_ERR_TOOL, "%s has too little shared memory for a network of width %u", device->base.info.name,
                       rows);
    if (cn_tracer_bytes(trace, max_rays) > device->base.info.bytes)
        return cn_fail(CN_ERR_NOMEM, "%s has %.1f GB; the tiles and their rays need %.1f GB", device->base.info.name,
                       (double)device->base.info.bytes / 1e9, (double)cn_tracer_bytes(trace, max_rays) / 1e9);
    CN_TRY(cn_device_stream_create(device, true, &t->stream));
    sizes(trace, max_rays, size);
    for (int i = 0; i < CN_TRACER_BUFFERS; i++)
        if (size[i]) CN_TRY(cn_device_buffer_create(device, size[i], false, &t->buffer[i]));
    CN_TRY(cn_tracer_store_pipelines(device, &(cn_tracer_sizes){ t->push.lanes, rows, cn_tracer_round(trace) },
                                     &t->pipelines));
    CN_TRY(send_parts(t, trace));
    return bind(t);
}

cn_status cn_tracer_create(cn_vulkan *device, const cn_trace *trace, uint32_t max_rays, cn_tracer **tracer)
{
    cn_tracer *t = *tracer = calloc(1, sizeof *t);
    if (!t) return cn_fail(CN_ERR_NOMEM, "out of memory");
    t->stream.device = device;
    const cn_status status = build(t, device, trace, max_rays);
    if (status != CN_OK) cn_tracer_destroy(tracer);
    return status;
}

void cn_tracer_destroy(cn_tracer **tracer)
{
    cn_tracer *t = *tracer;
    if (!t) return;
    cn_vulkan *device = t->stream.device;
    cn_tracer_bindings_destroy(device, &t->bindings);
    for (int i = 0; i < CN_TRACER_BUFFERS; i++)
        cn_device_buffer_destroy(device, &t->buffer[i]);
    for (int p = 0; p < CN_TRACE_PARTS; p++)
        cn_tracer_store_give_back(device, &t->field[p]);
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
    const size_t parts = t->push.parts;
    const header start = { .n_out = n };
    t->push.ratio = march->ratio;
    t->push.step = march->step;
    t->push.min_transmittance = march->min_transmittance;
    t->push.depth_left = march->depth_left;
    t->push.min_weight = march->min_weight;
    t->push.fine_depth = march->fine_depth;
    t->push.parity = 0;
    t->push.n_rays = n;
    uint32_t *list = malloc((n ? n : 1) * sizeof *list);
    if (!list) return cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < n; i++)
        list[i] = i;
    cn_status status = cn_device_put(&t->stream, &t->buffer[CN_TRACER_GOING], sizeof start, list, n * sizeof *list);
    free(list);
    if (status == CN_OK) status = cn_tracer_write(t, CN_TRACER_GOING, &start, sizeof start);
    if (status == CN_OK) status = cn_tracer_write(t, CN_TRACER_RAYS, batch->rays, n * parts * sizeof *batch->rays);
    if (status == CN_OK) status = cn_tracer_write(t, CN_TRACER_STATES, batch->states, n * sizeof *batch->states);
    if (status == CN_OK) status = cn_tracer_write(t, CN_TRACER_SUMS, batch->sums, n * parts * sizeof *batch->sums);
    const size_t columns = (size_t)n * t->push.columns * sizeof(float);
    if (status == CN_OK && columns) status = cn_tracer_write(t, CN_TRACER_COLUMNS, batch->columns, columns);
    return status;
}

/* Where the header has the groups of an operation; 0: the host knows them. */
static size_t groups_of(cn_tracer_pass op, uint32_t which)
{
    switch (op) {
    case CN_PASS_BEGIN:
    case CN_PASS_SKY: return 0;
    case CN_PASS_ENCODE: return offsetof(header, groups_level) + which * 4 * sizeof(uint32_t);
    case CN_PASS_DENSITY: return offsetof(header, groups_sample) + which * 4 * sizeof(uint32_t);
    case CN_PASS_COLOUR: return offsetof(header, groups_visible);
    default: return offsetof(header, groups_ray);
    }
}

/* Records one operation, of each part where it uses a table or weights, and a barrier for what it writes. */
static void record(cn_tracer *t, cn_tracer_pass op, uint32_t phase)
{
    const cn_vulkan *d = t->stream.device;
    const bool by_part = op == CN_PASS_ENCODE || op == CN_PASS_DENSITY || op == CN_PASS_COLOUR;
    VkCommandBuffer to = t->stream.commands;
    t->push.phase = phase;
    d->CmdBindPipeline(to, VK_PIPELINE_BIND_POINT_COMPUTE, t->pipelines->op[op]);
    for (uint32_t p = 0; p < (by_part ? t->push.parts : 1); p++) {
        const size_t groups = groups_of(op, p);
        t->push.part = p;
        d->CmdBindDescriptorSets(to, VK_PIPELINE_BIND_POINT_COMPUTE, t->pipelines->layout, 0, 1, &t->bindings.set[p], 0,
                                 NULL);
        d->CmdPushConstants(to, t->pipelines->layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof t->push, &t->push);
        if (op == CN_PASS_SKY)
            d->CmdDispatch(to, (t->push.n_rays + 63) / 64, t->push.parts, 1);
        else if (groups)
            d->CmdDispatchIndirect(to, t->buffer[CN_TRACER_GOING].handle, groups);
        else
            d->CmdDispatch(to, 1, 1, 1);
    }
    cn_device_stream_barrier(&t->stream);
}

static void record_round(cn_tracer *t)
{
    record(t, CN_PASS_BEGIN, 0);
    record(t, CN_PASS_MARCH, 0);
    if (t->push.parts > 1) record(t, CN_PASS_BEGIN, 1);
    record(t, CN_PASS_ENCODE, 0);
    record(t, CN_PASS_DENSITY, 0);
    record(t, CN_PASS_COMPOSITE, 0);
    record(t, CN_PASS_BEGIN, 2);
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
    if (march->sky) CN_TRY(cn_tracer_run_pass(t, CN_PASS_SKY, 0));
    CN_TRY(cn_tracer_read(t, CN_TRACER_SUMS, batch->sums, (size_t)batch->n * t->push.parts * sizeof *batch->sums));
    return cn_tracer_read(t, CN_TRACER_STATES, batch->states, batch->n * sizeof *batch->states);
}

/* Places stand in slots, as the samples of a round do. */
static cn_status query_slots(cn_tracer *t, const cn_density_query *query, size_t first, uint32_t n)
{
    const header start = { .n_in = n,
                           .groups_level = { { (n + 63) / 64, t->push.levels, 1 } },
                           .groups_sample = { { (n + t->push.lanes - 1) / t->push.lanes, 1, 1 } } };
    CN_TRY(cn_tracer_write(t, CN_TRACER_GOING, &start, sizeof start));
    CN_TRY(cn_tracer_write(t, CN_TRACER_PLACES, query->place + first, n * sizeof *query->place));
    CN_TRY(cn_device_stream_begin(&t->stream));
    record(t, CN_PASS_ENCODE, 1);
    record(t, CN_PASS_DENSITY, 1);
    CN_TRY(cn_device_stream_finish(&t->stream));
    return cn_tracer_read(t, CN_TRACER_FEATURES, query->logit + first, n * sizeof *query->logit);
}

cn_status cn_tracer_query(cn_tracer *t, const cn_context *ctx, const cn_density_query *query)
{
    const size_t slots = (size_t)t->push.max_rays * FULL_ROUND;
    for (size_t first = 0; first < query->n; first += slots) {
        if (cn_stopping(ctx))
            return cn_fail(CN_ERR_INTERRUPTED, "stopped while rendering; run the same command to resume");
        CN_TRY(query_slots(t, query, first, (uint32_t)(query->n - first < slots ? query->n - first : slots)));
    }
    return CN_OK;
}
