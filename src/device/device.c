/* The list of devices, the choice of a device, and code for all devices. */
#include "device/device.h"

#include <stdlib.h>
#include <string.h>

const cn_device_type *const cn_device_types[] = { &cn_device_processor, &cn_device_vulkan };
const uint32_t cn_device_n_types = sizeof cn_device_types / sizeof *cn_device_types;

const char *const cn_op_name[CN_OP_KINDS] = { "rays",     "march",          "lay out",   "place", "encode",  "shade",
                                              "optimise", "optimise table", "occupancy", "trace", "density", "pixels" };

cn_status cn_device_list(cn_device_info list[CN_DEVICE_MAX], uint32_t *n)
{
    return cn_device_vulkan.list(list, n);
}

/* Parses "gpu" as -1 and "gpu:N" as N. False when the text names no device of this type. */
static bool names(const char *choice, const cn_device_type *type, long *which)
{
    const size_t n = strlen(type->name);
    char *end = NULL;
    *which = -1;
    if (strncmp(choice, type->name, n) != 0) return false;
    if (!choice[n]) return true;
    if (!type->list || choice[n] != ':' || choice[n + 1] < '0' || choice[n + 1] > '9') return false;
    *which = strtol(choice + n + 1, &end, 10);
    return !*end;
}

cn_status cn_device_create(const char *choice, cn_device **device)
{
    long which;
    *device = NULL;
    if (!choice || !*choice) return cn_device_types[0]->open(-1, device);
    for (uint32_t i = 0; i < cn_device_n_types; i++)
        if (names(choice, cn_device_types[i], &which)) return cn_device_types[i]->open(which, device);
    return cn_fail(CN_ERR_USAGE, "there is no device '%s'; give cpu, gpu or gpu:0, gpu:1, ...", choice);
}

void cn_device_destroy(cn_device **device)
{
    if (*device) (*device)->type->close(*device);
    *device = NULL;
}

const cn_device_info *cn_device_about(const cn_device *device)
{
    return &device->info;
}

/* A context without a device uses the processor. */
static cn_device *device_of(const cn_context *ctx)
{
    static cn_device processor = { .type = &cn_device_processor };
    return ctx && ctx->device ? ctx->device : &processor;
}

cn_status cn_device_run(const cn_context *ctx, const cn_chain *chains, uint32_t n)
{
    cn_device *device = device_of(ctx);
    return device->type->run(device, ctx, chains, n);
}

cn_status cn_device_fetch(const cn_context *ctx, const cn_step_batch *step)
{
    cn_device *device = device_of(ctx);
    return device->type->fetch ? device->type->fetch(device, step) : CN_OK;
}

cn_status cn_device_forget(const cn_context *ctx, const cn_step_batch *step)
{
    cn_device *device = device_of(ctx);
    return device->type->forget ? device->type->forget(device, step) : CN_OK;
}

bool cn_device_is_lost(const cn_context *ctx)
{
    return __atomic_load_n(&device_of(ctx)->lost, __ATOMIC_RELAXED);
}

cn_status cn_device_arena_init(const cn_context *ctx, cn_arena *arena, size_t size)
{
    cn_device *device = device_of(ctx);
    return device->type->memory(device, size, arena);
}

void cn_device_arena_deinit(const cn_context *ctx, cn_arena *arena)
{
    cn_device *device = device_of(ctx);
    device->type->free_memory(device, arena);
}

const cn_kernel *cn_device_kernel(const cn_context *ctx, bool floats)
{
    const cn_device *device = device_of(ctx);
    if (device->kernel) return device->kernel;
    return floats ? cn_kernel_float() : cn_kernel_best();
}
