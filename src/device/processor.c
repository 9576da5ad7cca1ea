/* The processor as a device: the pool's threads run a chain item by item. */
#include "device/device.h"

#include <stdio.h>
#include <stdlib.h>

static cn_status open_processor(long which, cn_device **out)
{
    (void)which;
    cn_device *device = *out = calloc(1, sizeof *device);
    if (!device) return cn_fail(CN_ERR_NOMEM, "out of memory");
    device->type = &cn_device_processor;
    device->info.fit = true;
    snprintf(device->info.name, sizeof device->info.name, "the processor (%s)", cn_kernel_best()->name);
    return CN_OK;
}

static void close_processor(cn_device *device)
{
    free(device);
}

static cn_status take_memory(cn_device *device, size_t size, cn_arena *arena)
{
    (void)device;
    return cn_arena_init(arena, size);
}

static void free_memory(cn_device *device, cn_arena *arena)
{
    (void)device;
    cn_arena_deinit(arena);
}

static void run_item(void *user, size_t item, unsigned worker)
{
    const cn_chain *chain = user;
    while (item >= chain->items)
        item -= chain++->items;
    for (uint32_t i = 0; i < chain->n_ops; i++)
        chain->op[i].item(chain->user, item, worker);
}

void cn_processor_run(const cn_context *ctx, const cn_chain *chains, uint32_t n)
{
    cn_chain run[CN_CHAINS];
    size_t items = 0;
    for (uint32_t i = 0; i < n; i++) {
        run[i] = chains[i];
        items += chains[i].items;
    }
    cn_pool_run(ctx ? ctx->pool : NULL, items, run_item, run);
}

static cn_status run_chains(cn_device *device, const cn_context *ctx, const cn_chain *chains, uint32_t n)
{
    (void)device;
    cn_processor_run(ctx, chains, n);
    return CN_OK;
}

const cn_device_type cn_device_processor = { .name = "cpu",
                                             .open = open_processor,
                                             .close = close_processor,
                                             .memory = take_memory,
                                             .free_memory = free_memory,
                                             .run = run_chains };
