/* Runs chains of operations on a Vulkan device. When a chain has an operation for the device, a group of items is
 * processed at a time: the processor does the operations before it and packs the items, the device does them all, and
 * the processor continues. The processor does what the device cannot, and the log says so once. */
#include "device/step_run.h"
#include "device/step_session.h"
#include "device/store.h"
#include "device/tracer.h"

#include <stdlib.h>

enum { IN_FLIGHT = 512, LEAST_IN_FLIGHT = 128 };

typedef struct flight {
    const cn_chain *chain;
    uint32_t op; /* the operation for the device */
    size_t first;
    void *buffers;
    unsigned char *kept;
} flight;

static cn_op_packed packed_at(const flight *f, size_t place)
{
    return (cn_op_packed){ f->buffers, f->kept + place * f->chain->op[f->op].keep, place };
}

static void before(void *user, size_t place, unsigned worker)
{
    const flight *f = user;
    const cn_op_packed packed = packed_at(f, place);
    for (uint32_t i = 0; i < f->op; i++)
        f->chain->op[i].item(f->chain->user, f->first + place, worker);
    f->chain->op[f->op].pack(f->chain->user, worker, &packed);
}

static void after(void *user, size_t place, unsigned worker)
{
    const flight *f = user;
    const cn_op_packed packed = packed_at(f, place);
    f->chain->op[f->op].unpack(f->chain->user, worker, &packed);
    for (uint32_t i = f->op + 1; i < f->chain->n_ops; i++)
        f->chain->op[i].item(f->chain->user, f->first + place, worker);
}

static cn_status fly(flight *f, cn_tracer *tracer, const cn_context *ctx, size_t in_flight)
{
    const cn_trace *trace = f->chain->op[f->op].batch;
    const cn_trace_buffers *b = f->buffers;
    uint64_t samples = 0;
    for (f->first = 0; f->first < f->chain->items; f->first += in_flight) {
        const size_t left = f->chain->items - f->first, n = left < in_flight ? left : in_flight;
        const cn_device_batch batch = { (uint32_t)n * CN_TRACE_RAYS, b->rays, b->columns, b->states, b->sums };
        cn_pool_run(ctx->pool, n, before, f);
        CN_TRY(cn_tracer_run(tracer, ctx, &trace->march, &batch, &samples));
        cn_pool_run(ctx->pool, n, after, f);
    }
    if (trace->samples) __atomic_fetch_add(trace->samples, samples, __ATOMIC_RELAXED);
    return CN_OK;
}

static void carve(cn_arena *arena, size_t in_flight, cn_trace_buffers *b, flight *f)
{
    const cn_trace *trace = f->chain->op[f->op].batch;
    const size_t rays = in_flight * CN_TRACE_RAYS, keep = f->chain->op[f->op].keep;
    b->rays = CN_ARENA_NEW(arena, cn_device_ray, rays * trace->n_parts);
    b->states = CN_ARENA_NEW(arena, cn_device_state, rays);
    b->sums = CN_ARENA_NEW(arena, cn_device_sum, rays * trace->n_parts);
    b->columns = CN_ARENA_NEW(arena, float, rays *cn_trace_columns(trace) + 1);
    f->kept = CN_ARENA_NEW(arena, unsigned char, in_flight *keep + 1);
    f->buffers = b;
}

static cn_status trace_chain(cn_vulkan *device, const cn_context *ctx, const cn_chain *chain, uint32_t op)
{
    const cn_trace *trace = chain->op[op].batch;
    /* The more parts, the more each ray needs. */
    const size_t most = IN_FLIGHT / trace->n_parts > LEAST_IN_FLIGHT ? IN_FLIGHT / trace->n_parts : LEAST_IN_FLIGHT;
    const size_t in_flight = chain->items < most ? chain->items : most;
    flight f = { .chain = chain, .op = op };
    cn_trace_buffers buffers;
    cn_tracer *tracer = NULL;
    cn_arena counter, arena = { 0 };
    cn_arena_count(&counter);
    carve(&counter, in_flight, &buffers, &f);
    CN_TRY(cn_vulkan_memory(&device->base, counter.used, &arena));
    carve(&arena, in_flight, &buffers, &f);
    cn_status status = cn_tracer_create(device, trace, (uint32_t)in_flight * CN_TRACE_RAYS, &tracer);
    if (status == CN_OK) status = fly(&f, tracer, ctx, in_flight);
    cn_tracer_destroy(&tracer);
    cn_vulkan_free_memory(&device->base, &arena);
    return status;
}

/* Places of a query on the device at a time, by rays of a full round. */
enum { QUERY_RAYS = 1 << 15, PLACES_OF_RAY = 8 };

static cn_status query_chain(cn_vulkan *device, const cn_context *ctx, const cn_density_query *query)
{
    const size_t rays = (query->n + PLACES_OF_RAY - 1) / PLACES_OF_RAY;
    const cn_trace trace = { .n_parts = 1, .part = { { .field = query->field } } };
    cn_tracer *tracer;
    if (!query->n) return CN_OK;
    cn_status status = cn_tracer_create(device, &trace, rays < QUERY_RAYS ? (uint32_t)rays : QUERY_RAYS, &tracer);
    if (status == CN_OK) status = cn_tracer_query(tracer, ctx, query);
    cn_tracer_destroy(&tracer);
    return status;
}

static void say_once(cn_vulkan *device, const cn_context *ctx, cn_op_kind kind, const char *why)
{
    if (!ctx || !ctx->log) return; /* another caller will hear it */
    if (!__atomic_exchange_n(&device->said[kind], true, __ATOMIC_RELAXED))
        cn_log(ctx, CN_LOG_WARN, "%s; the processor does it instead", why);
}

/* The operation of a chain that the device does; n_ops: none. */
static uint32_t find_op(cn_vulkan *device, const cn_context *ctx, const cn_chain *chain)
{
    for (uint32_t i = 0; i < chain->n_ops; i++) {
        const cn_op *op = &chain->op[i];
        if (op->kind != CN_OP_TRACE && op->kind != CN_OP_DENSITY) continue;
        if (op->batch) return i;
        say_once(device, ctx, op->kind, "a graphics processor renders tiles of a grid and two networks so far");
    }
    return chain->n_ops;
}

/* True when the device has done all of the chain, or was asked to stop. */
static bool takes(cn_vulkan *device, const cn_context *ctx, const cn_chain *chain, cn_status *status)
{
    const uint32_t op = find_op(device, ctx, chain);
    if (op == chain->n_ops || !chain->items) return false;
    *status = chain->op[op].kind == CN_OP_TRACE ? trace_chain(device, ctx, chain, op)
                                                : query_chain(device, ctx, chain->op[op].batch);
    if (*status == CN_OK || *status == CN_ERR_INTERRUPTED) return true;
    say_once(device, ctx, chain->op[op].kind, cn_error_message());
    return false;
}

/* All operations of a training step have the same batch. */
static bool is_step(const cn_chain *chain)
{
    return chain->op[0].kind < CN_OP_TRACE && chain->op[0].batch;
}

static cn_status run_chains(cn_device *base, const cn_context *ctx, const cn_chain *chains, uint32_t n)
{
    cn_chain left[CN_CHAINS];
    uint32_t n_left = 0;
    cn_status status = CN_OK;
    for (uint32_t i = 0; i < n && status == CN_OK; i++) {
        if (is_step(&chains[i]))
            status = cn_step_run((cn_vulkan *)base, ctx, &chains[i]);
        else if (!takes((cn_vulkan *)base, ctx, &chains[i], &status)) {
            left[n_left++] = chains[i];
            status = CN_OK;
        }
    }
    if (status == CN_OK) cn_processor_run(ctx, left, n_left);
    return status;
}

static void close_vulkan(cn_device *device)
{
    cn_step_close((cn_vulkan *)device, NULL);
    cn_tracer_store_close((cn_vulkan *)device);
    cn_vulkan_close(device);
}

static void free_memory(cn_device *device, cn_arena *arena)
{
    if (arena->base) cn_step_close((cn_vulkan *)device, arena);
    cn_vulkan_free_memory(device, arena);
}

static cn_status open_vulkan(long which, cn_device **device)
{
    CN_TRY(cn_vulkan_open(which, device));
    (*device)->type = &cn_device_vulkan;
    return CN_OK;
}

const cn_device_type cn_device_vulkan = { .name = "gpu",
                                          .list = cn_vulkan_list,
                                          .open = open_vulkan,
                                          .close = close_vulkan,
                                          .memory = cn_vulkan_memory,
                                          .free_memory = free_memory,
                                          .run = run_chains,
                                          .fetch = cn_step_fetch,
                                          .forget = cn_step_forget,
                                          .available = cn_vulkan_available,
                                          .step_bytes = cn_step_session_bytes,
                                          .map_bytes = cn_step_session_map_bytes };
