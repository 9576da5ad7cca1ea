/* Shared by the Vulkan files: the functions in use, a buffer, the open device. */
#ifndef CONURB_DEVICE_VULKAN_H
#define CONURB_DEVICE_VULKAN_H
#include "device/device.h"

#define VK_NO_PROTOTYPES
#include <pthread.h>
#include <vulkan/vulkan_core.h>

/* Functions of an instance, then those of a device. */
#define CN_VK_INSTANCE(X)                                                                                              \
    X(EnumeratePhysicalDevices)                                                                                        \
    X(GetPhysicalDeviceProperties)                                                                                     \
    X(GetPhysicalDeviceProperties2)                                                                                    \
    X(GetPhysicalDeviceMemoryProperties)                                                                               \
    X(GetPhysicalDeviceMemoryProperties2)                                                                              \
    X(EnumerateDeviceExtensionProperties)                                                                              \
    X(GetPhysicalDeviceQueueFamilyProperties)                                                                          \
    X(CreateDevice)                                                                                                    \
    X(GetDeviceProcAddr)
#define CN_VK_DEVICE(X)                                                                                                \
    X(DestroyDevice)                                                                                                   \
    X(GetDeviceQueue)                                                                                                  \
    X(CreateBuffer)                                                                                                    \
    X(DestroyBuffer)                                                                                                   \
    X(GetBufferMemoryRequirements)                                                                                     \
    X(AllocateMemory)                                                                                                  \
    X(FreeMemory)                                                                                                      \
    X(BindBufferMemory)                                                                                                \
    X(MapMemory)                                                                                                       \
    X(CreateShaderModule)                                                                                              \
    X(DestroyShaderModule)                                                                                             \
    X(CreateDescriptorSetLayout)                                                                                       \
    X(DestroyDescriptorSetLayout)                                                                                      \
    X(CreatePipelineLayout)                                                                                            \
    X(DestroyPipelineLayout)                                                                                           \
    X(CreateComputePipelines)                                                                                          \
    X(DestroyPipeline)                                                                                                 \
    X(CreateDescriptorPool)                                                                                            \
    X(DestroyDescriptorPool)                                                                                           \
    X(AllocateDescriptorSets)                                                                                          \
    X(UpdateDescriptorSets)                                                                                            \
    X(CreateCommandPool)                                                                                               \
    X(DestroyCommandPool)                                                                                              \
    X(AllocateCommandBuffers)                                                                                          \
    X(BeginCommandBuffer)                                                                                              \
    X(EndCommandBuffer)                                                                                                \
    X(CreateFence)                                                                                                     \
    X(DestroyFence)                                                                                                    \
    X(WaitForFences)                                                                                                   \
    X(ResetFences)                                                                                                     \
    X(QueueSubmit)                                                                                                     \
    X(CmdBindPipeline)                                                                                                 \
    X(CmdBindDescriptorSets)                                                                                           \
    X(CmdPushConstants)                                                                                                \
    X(CmdDispatch)                                                                                                     \
    X(CmdDispatchIndirect)                                                                                             \
    X(CmdPipelineBarrier)                                                                                              \
    X(CmdCopyBuffer)                                                                                                   \
    X(CmdFillBuffer)                                                                                                   \
    X(CmdUpdateBuffer)

#define CN_VK_MEMBER(name) PFN_vk##name name;
typedef struct cn_vk_instance {
    VkInstance handle;
    CN_VK_INSTANCE(CN_VK_MEMBER)
} cn_vk_instance;

typedef struct cn_device_buffer {
    VkBuffer handle;
    VkDeviceMemory memory;
    size_t size;
    void *mapped; /* NULL when the host cannot access it */
} cn_device_buffer;

/* Memory that both the device and the processor can access. */
typedef struct cn_vk_memory {
    cn_device_buffer buffer;
    struct cn_vk_memory *next;
} cn_vk_memory;

typedef struct cn_vulkan {
    cn_device base;
    CN_VK_DEVICE(CN_VK_MEMBER)
    VkPhysicalDevice physical;
    VkDevice handle;
    VkQueue queue;
    uint32_t family;
    pthread_mutex_t lock; /* of the queue */
    VkPhysicalDeviceProperties properties;
    VkPhysicalDeviceMemoryProperties heaps;
    uint64_t block_bytes;             /* the most that one buffer of the photos' maps holds (step_session.h) */
    cn_vk_memory *memories;           /* list, protected by the lock */
    struct cn_step_session *sessions; /* trainings on the device; list, protected by the lock */
    struct cn_tracer_store *store;    /* what is kept between two renders (store.h); made under the lock */
    /* Frees what is kept only to save time; false: there was nothing. NULL: nothing was ever kept. */
    bool (*trim)(struct cn_vulkan *device);
    bool said[CN_OP_KINDS]; /* the log has said that this operation is left to the processor */
} cn_vulkan;

/* Converts an error of Vulkan to a status; `what` is the action that failed. */
CN_NODISCARD cn_status cn_device_failed(cn_vulkan *device, VkResult result, const char *what);
#define CN_VK_TRY(device, call, what)                                                                                  \
    do {                                                                                                               \
        const VkResult cn_vk_result_ = (call);                                                                         \
        if (cn_vk_result_ != VK_SUCCESS) return cn_device_failed(device, cn_vk_result_, what);                         \
    } while (0)

/* on_host: memory that the host maps, and reads fast where the device has such memory; else the device's own. */
CN_NODISCARD cn_status cn_device_buffer_create(cn_vulkan *device, size_t size, bool on_host, cn_device_buffer *buffer);
void cn_device_buffer_destroy(cn_vulkan *device, cn_device_buffer *buffer);

/* As in cn_device_type; the caller sets the type of the open device. When the driver has no shared memory left, the
 * memory is the processor's: renders copy it, and no training opens on the device. */
CN_NODISCARD cn_status cn_vulkan_list(cn_device_info list[CN_DEVICE_MAX], uint32_t *n);
CN_NODISCARD cn_status cn_vulkan_open(long which, cn_device **device);
void cn_vulkan_close(cn_device *device);
uint64_t cn_vulkan_available(cn_device *device);
CN_NODISCARD cn_status cn_vulkan_memory(cn_device *device, size_t size, cn_arena *arena);
void cn_vulkan_free_memory(cn_device *device, cn_arena *arena);

/* The commands of one thread, with a staging buffer for transfers (none where `staging` is false). */
typedef struct cn_device_stream {
    cn_vulkan *device;
    VkCommandPool pool;
    VkCommandBuffer commands;
    VkFence fence;
    cn_device_buffer staging;
} cn_device_stream;
CN_NODISCARD cn_status cn_device_stream_create(cn_vulkan *device, bool staging, cn_device_stream *stream);
void cn_device_stream_destroy(cn_device_stream *stream);
CN_NODISCARD cn_status cn_device_stream_begin(cn_device_stream *stream);
/* Submits what was recorded since begin, and waits until it is done. Both steps, or one at a time. */
CN_NODISCARD cn_status cn_device_stream_finish(cn_device_stream *stream);
CN_NODISCARD cn_status cn_device_stream_submit(cn_device_stream *stream);
CN_NODISCARD cn_status cn_device_stream_wait(cn_device_stream *stream);
/* The buffer of the device's memory that contains these bytes, and where they begin. NULL: it is the processor's
 * memory.
 */
VkBuffer cn_device_find(cn_vulkan *device, const void *data, size_t size, VkDeviceSize *offset);
/* A barrier: makes earlier writes visible to shaders, copies and indirect dispatches. */
void cn_device_stream_barrier(cn_device_stream *stream);
CN_NODISCARD cn_status cn_device_put(cn_device_stream *stream, const cn_device_buffer *to, size_t offset,
                                     const void *data, size_t size);
CN_NODISCARD cn_status cn_device_get(cn_device_stream *stream, const cn_device_buffer *from, size_t offset, void *data,
                                     size_t size);
#endif
