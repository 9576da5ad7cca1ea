/* The list of devices, the choice of a device, and code for all devices. */
#include "device/device.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const cn_device_type *const cn_device_types[] = { &cn_device_processor, &cn_device_vulkan };
const uint32_t cn_device_n_types = sizeof cn_device_types / sizeof *cn_device_types;

const char *const cn_op_name[CN_OP_KINDS] = { "rays",  "march",    "lay out",        "place",     "encode",
                                              "shade", "optimise", "optimise table", "occupancy", "refill",
                                              "trace", "density",  "pixels" };

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

/* Opens the devices that one name of a list stands for. */
static cn_status open_named(const char *name, cn_device **device)
{
    long which;
    cn_device_info list[CN_DEVICE_MAX];
    uint32_t n;
    if (strcmp(name, "gpu:all") != 0) {
        for (uint32_t i = 0; i < cn_device_n_types; i++)
            if (names(name, cn_device_types[i], &which)) return cn_device_types[i]->open(which, device);
        return cn_fail(
            CN_ERR_USAGE,
            "there is no device '%s'; give auto, cpu, gpu, gpu:0, gpu:1, ..., several with commas, or gpu:all", name);
    }
    CN_TRY(cn_device_vulkan.list(list, &n));
    cn_device **end = device;
    for (uint32_t i = 0; i < n; i++) {
        if (!list[i].fit || list[i].software) continue;
        CN_TRY(cn_device_vulkan.open(i, end));
        end = &(*end)->next;
    }
    return *device ? CN_OK : cn_device_vulkan.open(-1, device); /* which says why there is none */
}

static cn_status open_automatic(cn_device **device)
{
    if (cn_device_vulkan.open(-1, device) != CN_OK) CN_TRY(cn_device_processor.open(-1, device));
    (*device)->info.automatic = true;
    return CN_OK;
}

cn_status cn_device_create(const char *choice, cn_device **device)
{
    cn_status status = CN_OK;
    *device = NULL;
    if (!choice || !*choice) return cn_device_types[0]->open(-1, device);
    if (strcmp(choice, "auto") == 0) return open_automatic(device);
    cn_device **end = device;
    for (const char *at = choice; at && status == CN_OK;) {
        char name[64];
        const size_t length = strcspn(at, ",");
        snprintf(name, sizeof name, "%.*s", (int)(length < sizeof name ? length : sizeof name - 1), at);
        status = open_named(name, end);
        while (*end)
            end = &(*end)->next;
        at = at[length] ? at + length + 1 : NULL;
    }
    if (status != CN_OK) cn_device_destroy(device);
    return status;
}

void cn_device_destroy(cn_device **device)
{
    for (cn_device *at = *device, *next; at; at = next) {
        next = at->next;
        at->type->close(at);
    }
    *device = NULL;
}

cn_device *cn_device_next(const cn_device *device)
{
    return device->next;
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

uint64_t cn_device_available(const cn_context *ctx)
{
    cn_device *device = device_of(ctx);
    return device->type->available ? device->type->available(device) : UINT64_MAX;
}

uint64_t cn_device_step_bytes(const cn_step_batch *step)
{
    return cn_device_vulkan.step_bytes(step);
}

uint64_t cn_device_map_bytes(const cn_step_batch *step)
{
    return cn_device_vulkan.map_bytes(step);
}

bool cn_device_is_lost(const cn_context *ctx)
{
    return __atomic_load_n(&device_of(ctx)->lost, __ATOMIC_RELAXED);
}

bool cn_device_gave_up(const cn_context *ctx, cn_status status)
{
    const bool has_memory = cn_device_available(ctx) != UINT64_MAX;
    return cn_device_is_lost(ctx) || (has_memory && (status == CN_ERR_TOOL || status == CN_ERR_NOMEM));
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
