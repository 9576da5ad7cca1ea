#include "device_clock.h"

#include <dlfcn.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_PIPELINES = 512 };

#define OWN(X) X(CreateQueryPool) X(DestroyQueryPool) X(CmdResetQueryPool) X(CmdWriteTimestamp) X(GetQueryPoolResults)

static struct {
    cn_vulkan *device, plain; /* plain: the functions of the driver */
    OWN(CN_VK_MEMBER)
    VkQueryPool pool;
    bool on;
    uint32_t n, n_made;
    VkPipeline bound, of[BENCH_DISPATCHES], made[MOST_PIPELINES];
    uint64_t times[2 * BENCH_DISPATCHES];
} at;

static VKAPI_ATTR VkResult VKAPI_CALL make(VkDevice device, VkPipelineCache cache, uint32_t n,
                                           const VkComputePipelineCreateInfo *info, const VkAllocationCallbacks *memory,
                                           VkPipeline *out)
{
    const VkResult result = at.plain.CreateComputePipelines(device, cache, n, info, memory, out);
    for (uint32_t i = 0; i < n && result == VK_SUCCESS && at.n_made < MOST_PIPELINES; i++)
        at.made[at.n_made++] = out[i];
    return result;
}

static VKAPI_ATTR void VKAPI_CALL bind(VkCommandBuffer commands, VkPipelineBindPoint point, VkPipeline pipeline)
{
    at.bound = pipeline;
    at.plain.CmdBindPipeline(commands, point, pipeline);
}

/* Both timestamps wait for the commands before them. */
static bool before(VkCommandBuffer commands)
{
    if (!at.on || at.n == BENCH_DISPATCHES) return false;
    at.of[at.n] = at.bound;
    at.CmdResetQueryPool(commands, at.pool, 2 * at.n, 2);
    at.CmdWriteTimestamp(commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, at.pool, 2 * at.n);
    return true;
}

static void after(VkCommandBuffer commands)
{
    at.CmdWriteTimestamp(commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, at.pool, 2 * at.n + 1);
    at.n++;
}

static VKAPI_ATTR void VKAPI_CALL dispatch(VkCommandBuffer commands, uint32_t x, uint32_t y, uint32_t z)
{
    const bool timed = before(commands);
    at.plain.CmdDispatch(commands, x, y, z);
    if (timed) after(commands);
}

static VKAPI_ATTR void VKAPI_CALL dispatch_indirect(VkCommandBuffer commands, VkBuffer buffer, VkDeviceSize offset)
{
    const bool timed = before(commands);
    at.plain.CmdDispatchIndirect(commands, buffer, offset);
    if (timed) after(commands);
}

cn_status bench_clock_open(cn_vulkan *device)
{
    void *loader = dlopen("libvulkan.so.1", RTLD_NOW | RTLD_LOCAL), *symbol;
    PFN_vkGetDeviceProcAddr get = NULL;
    symbol = loader ? dlsym(loader, "vkGetDeviceProcAddr") : NULL;
    memcpy(&get, &symbol, sizeof get);
    if (!get) return cn_fail(CN_ERR_TOOL, "the Vulkan loader is not installed");
#define LOAD(name) at.name = (PFN_vk##name)get(device->handle, "vk" #name);
    OWN(LOAD)
#undef LOAD
    const VkQueryPoolCreateInfo info = { .sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
                                         .queryType = VK_QUERY_TYPE_TIMESTAMP,
                                         .queryCount = 2 * BENCH_DISPATCHES };
    if (!device->properties.limits.timestampComputeAndGraphics ||
        at.CreateQueryPool(device->handle, &info, NULL, &at.pool) != VK_SUCCESS)
        return cn_fail(CN_ERR_TOOL, "%s has no clock", device->base.info.name);
    at.device = device;
    at.plain = *device;
    device->CreateComputePipelines = make;
    device->CmdBindPipeline = bind;
    device->CmdDispatch = dispatch;
    device->CmdDispatchIndirect = dispatch_indirect;
    return CN_OK;
}

void bench_clock_close(void)
{
    if (!at.device) return;
    at.device->CreateComputePipelines = at.plain.CreateComputePipelines;
    at.device->CmdBindPipeline = at.plain.CmdBindPipeline;
    at.device->CmdDispatch = at.plain.CmdDispatch;
    at.device->CmdDispatchIndirect = at.plain.CmdDispatchIndirect;
    at.DestroyQueryPool(at.device->handle, at.pool, NULL);
    at.device = NULL;
}

void bench_clock_begin(void)
{
    at.n = 0;
    at.on = true;
}

cn_status bench_clock_end(void)
{
    at.on = false;
    if (!at.n) return CN_OK;
    CN_VK_TRY(at.device,
              at.GetQueryPoolResults(at.device->handle, at.pool, 0, 2 * at.n, 2 * at.n * sizeof *at.times, at.times,
                                     sizeof *at.times, VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT),
              "tell the time");
    return CN_OK;
}

double bench_clock_sum(VkPipeline pipeline)
{
    double ticks = 0;
    for (uint32_t i = 0; i < at.n; i++)
        if (!pipeline || at.of[i] == pipeline) ticks += (double)(at.times[2 * i + 1] - at.times[2 * i]);
    return ticks * (double)at.device->properties.limits.timestampPeriod * 1e-9;
}

VkPipeline bench_clock_made(uint32_t i)
{
    return i < at.n_made ? at.made[i] : VK_NULL_HANDLE;
}

uint32_t bench_clock_count(void)
{
    return at.n_made;
}
