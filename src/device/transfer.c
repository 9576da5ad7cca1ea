/* Buffers, and transfers between them and the host. */
#include "device/vulkan.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { STAGING = 8 << 20 };

static uint32_t memory_type(cn_vulkan *device, uint32_t allowed, VkMemoryPropertyFlags wanted)
{
    for (uint32_t i = 0; i < device->heaps.memoryTypeCount; i++)
        if (allowed >> i & 1 && (device->heaps.memoryTypes[i].propertyFlags & wanted) == wanted) return i;
    return UINT32_MAX;
}

/* Every device has memory that the processor sees. Where none of it is cached, the processor reads it slowly. */
static uint32_t host_memory_type(cn_vulkan *device, uint32_t allowed)
{
    const VkMemoryPropertyFlags seen = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    const uint32_t cached = memory_type(device, allowed, seen | VK_MEMORY_PROPERTY_HOST_CACHED_BIT);
    return cached != UINT32_MAX ? cached : memory_type(device, allowed, seen);
}

cn_status cn_device_buffer_create(cn_vulkan *device, size_t size, bool on_host, cn_device_buffer *buffer)
{
    *buffer = (cn_device_buffer){ .size = size };
    if (!on_host && size > device->properties.limits.maxStorageBufferRange)
        return cn_fail(CN_ERR_NOMEM, "%s cannot allocate a buffer of %zu bytes", device->base.info.name, size);
    const VkBufferCreateInfo info = { .sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                                      .size = size,
                                      .usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT |
                                               VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_SRC_BIT |
                                               VK_BUFFER_USAGE_TRANSFER_DST_BIT };
    CN_VK_TRY(device, device->CreateBuffer(device->handle, &info, NULL, &buffer->handle), "make a buffer");
    VkMemoryRequirements wanted;
    device->GetBufferMemoryRequirements(device->handle, buffer->handle, &wanted);
    const uint32_t type = on_host ? host_memory_type(device, wanted.memoryTypeBits)
                                  : memory_type(device, wanted.memoryTypeBits, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT);
    if (type == UINT32_MAX)
        return cn_fail(CN_ERR_TOOL, "%s has no memory of the kind that is needed", device->base.info.name);
    const VkMemoryAllocateInfo memory = { .sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
                                          .allocationSize = wanted.size,
                                          .memoryTypeIndex = type };
    VkResult result = device->AllocateMemory(device->handle, &memory, NULL, &buffer->memory);
    if (result == VK_ERROR_OUT_OF_DEVICE_MEMORY && device->trim && device->trim(device))
        result = device->AllocateMemory(device->handle, &memory, NULL, &buffer->memory);
    CN_VK_TRY(device, result, "hold a buffer");
    CN_VK_TRY(device, device->BindBufferMemory(device->handle, buffer->handle, buffer->memory, 0), "hold a buffer");
    if (on_host)
        CN_VK_TRY(device, device->MapMemory(device->handle, buffer->memory, 0, size, 0, &buffer->mapped),
                  "map a buffer");
    return CN_OK;
}

void cn_device_buffer_destroy(cn_vulkan *device, cn_device_buffer *buffer)
{
    if (buffer->handle) device->DestroyBuffer(device->handle, buffer->handle, NULL);
    if (buffer->memory) device->FreeMemory(device->handle, buffer->memory, NULL);
    *buffer = (cn_device_buffer){ 0 };
}

cn_status cn_device_stream_create(cn_vulkan *device, bool staging, cn_device_stream *stream)
{
    *stream = (cn_device_stream){ .device = device };
    const VkCommandPoolCreateInfo pool = { .sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                           .flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT,
                                           .queueFamilyIndex = device->family };
    CN_VK_TRY(device, device->CreateCommandPool(device->handle, &pool, NULL, &stream->pool), "take commands");
    const VkCommandBufferAllocateInfo commands = { .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                                   .commandPool = stream->pool,
                                                   .level = VK_COMMAND_BUFFER_LEVEL_PRIMARY,
                                                   .commandBufferCount = 1 };
    CN_VK_TRY(device, device->AllocateCommandBuffers(device->handle, &commands, &stream->commands), "take commands");
    const VkFenceCreateInfo fence = { .sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO };
    CN_VK_TRY(device, device->CreateFence(device->handle, &fence, NULL, &stream->fence), "make a fence");
    return staging ? cn_device_buffer_create(device, STAGING, true, &stream->staging) : CN_OK;
}

void cn_device_stream_destroy(cn_device_stream *stream)
{
    cn_vulkan *device = stream->device;
    if (!device) return;
    cn_device_buffer_destroy(device, &stream->staging);
    if (stream->fence) device->DestroyFence(device->handle, stream->fence, NULL);
    if (stream->pool) device->DestroyCommandPool(device->handle, stream->pool, NULL);
    *stream = (cn_device_stream){ 0 };
}

cn_status cn_device_stream_begin(cn_device_stream *stream)
{
    cn_vulkan *device = stream->device;
    const VkCommandBufferBeginInfo info = { .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO,
                                            .flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT };
    CN_VK_TRY(device, device->BeginCommandBuffer(stream->commands, &info), "take commands");
    return CN_OK;
}

cn_status cn_device_stream_submit(cn_device_stream *stream)
{
    cn_vulkan *device = stream->device;
    cn_device_stream_barrier(stream);
    CN_VK_TRY(device, device->EndCommandBuffer(stream->commands), "take commands");
    const VkSubmitInfo info = { .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO,
                                .commandBufferCount = 1,
                                .pCommandBuffers = &stream->commands };
    pthread_mutex_lock(&device->lock);
    const VkResult result = device->QueueSubmit(device->queue, 1, &info, stream->fence);
    pthread_mutex_unlock(&device->lock);
    CN_VK_TRY(device, result, "run");
    return CN_OK;
}

cn_status cn_device_stream_wait(cn_device_stream *stream)
{
    cn_vulkan *device = stream->device;
    CN_VK_TRY(device, device->WaitForFences(device->handle, 1, &stream->fence, VK_TRUE, UINT64_MAX), "run");
    CN_VK_TRY(device, device->ResetFences(device->handle, 1, &stream->fence), "run");
    return CN_OK;
}

cn_status cn_device_stream_finish(cn_device_stream *stream)
{
    CN_TRY(cn_device_stream_submit(stream));
    return cn_device_stream_wait(stream);
}

void cn_device_stream_barrier(cn_device_stream *stream)
{
    const VkMemoryBarrier barrier = { .sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                      .srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT,
                                      .dstAccessMask = VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT |
                                                       VK_ACCESS_INDIRECT_COMMAND_READ_BIT |
                                                       VK_ACCESS_TRANSFER_READ_BIT | VK_ACCESS_TRANSFER_WRITE_BIT |
                                                       VK_ACCESS_HOST_READ_BIT };
    const VkPipelineStageFlags work = VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT;
    stream->device->CmdPipelineBarrier(stream->commands, work,
                                       work | VK_PIPELINE_STAGE_DRAW_INDIRECT_BIT | VK_PIPELINE_STAGE_HOST_BIT, 0, 1,
                                       &barrier, 0, NULL, 0, NULL);
}

/* The device memory that contains these bytes, or NULL when it is the processor's memory. */
static const cn_vk_memory *memory_of(cn_vulkan *device, const void *data, size_t size)
{
    const uintptr_t first = (uintptr_t)data;
    pthread_mutex_lock(&device->lock);
    const cn_vk_memory *m = device->memories;
    for (; m; m = m->next) {
        const uintptr_t base = (uintptr_t)m->buffer.mapped;
        if (first >= base && first + size <= base + m->buffer.size) break;
    }
    pthread_mutex_unlock(&device->lock);
    return m;
}

static VkDeviceSize offset_in(const cn_vk_memory *memory, const void *data)
{
    return (VkDeviceSize)((const unsigned char *)data - (const unsigned char *)memory->buffer.mapped);
}

VkBuffer cn_device_find(cn_vulkan *device, const void *data, size_t size, VkDeviceSize *offset)
{
    const cn_vk_memory *m = memory_of(device, data, size);
    *offset = m ? offset_in(m, data) : 0;
    return m ? m->buffer.handle : VK_NULL_HANDLE;
}

static cn_status copy(cn_device_stream *stream, VkBuffer from, VkBuffer to, const VkBufferCopy *what)
{
    CN_TRY(cn_device_stream_begin(stream));
    stream->device->CmdCopyBuffer(stream->commands, from, to, 1, what);
    return cn_device_stream_finish(stream);
}

cn_status cn_device_put(cn_device_stream *stream, const cn_device_buffer *to, size_t offset, const void *data,
                        size_t size)
{
    const cn_vk_memory *shared = memory_of(stream->device, data, size);
    if (shared) {
        const VkBufferCopy all = { offset_in(shared, data), offset, size };
        return size ? copy(stream, shared->buffer.handle, to->handle, &all) : CN_OK;
    }
    for (size_t done = 0; done < size;) {
        const size_t n = size - done < STAGING ? size - done : STAGING;
        const VkBufferCopy part = { .dstOffset = offset + done, .size = n };
        memcpy(stream->staging.mapped, (const char *)data + done, n);
        CN_TRY(copy(stream, stream->staging.handle, to->handle, &part));
        done += n;
    }
    return CN_OK;
}

cn_status cn_device_get(cn_device_stream *stream, const cn_device_buffer *from, size_t offset, void *data, size_t size)
{
    const cn_vk_memory *shared = memory_of(stream->device, data, size);
    if (shared) {
        const VkBufferCopy all = { offset, offset_in(shared, data), size };
        return size ? copy(stream, from->handle, shared->buffer.handle, &all) : CN_OK;
    }
    for (size_t done = 0; done < size;) {
        const size_t n = size - done < STAGING ? size - done : STAGING;
        const VkBufferCopy part = { .srcOffset = offset + done, .size = n };
        CN_TRY(copy(stream, from->handle, stream->staging.handle, &part));
        memcpy((char *)data + done, stream->staging.mapped, n);
        done += n;
    }
    return CN_OK;
}

cn_status cn_vulkan_memory(cn_device *base, size_t size, cn_arena *arena)
{
    cn_vulkan *device = (cn_vulkan *)base;
    cn_vk_memory *m = calloc(1, sizeof *m);
    if (!m) return cn_fail(CN_ERR_NOMEM, "out of memory");
    if (cn_device_buffer_create(device, size ? size : 1, true, &m->buffer) != CN_OK) {
        cn_device_buffer_destroy(device, &m->buffer);
        free(m);
        return cn_arena_init(arena, size);
    }
    memset(m->buffer.mapped, 0, size);
    *arena = (cn_arena){ .base = m->buffer.mapped, .size = size };
    pthread_mutex_lock(&device->lock);
    m->next = device->memories;
    device->memories = m;
    pthread_mutex_unlock(&device->lock);
    return CN_OK;
}

void cn_vulkan_free_memory(cn_device *base, cn_arena *arena)
{
    cn_vulkan *device = (cn_vulkan *)base;
    pthread_mutex_lock(&device->lock);
    cn_vk_memory **at = &device->memories;
    while (*at && (*at)->buffer.mapped != arena->base)
        at = &(*at)->next;
    cn_vk_memory *m = arena->base ? *at : NULL;
    if (m) *at = m->next;
    pthread_mutex_unlock(&device->lock);
    if (!m) {
        cn_arena_deinit(arena);
        return;
    }
    cn_device_buffer_destroy(device, &m->buffer);
    free(m);
    *arena = (cn_arena){ 0 };
}
