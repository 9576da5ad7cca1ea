/* The Vulkan loader, opened at run time, and its devices. */
#include "device/vulkan.h"

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WANTED_BUFFERS = 16, WANTED_SHARED = 16384, WANTED_THREADS = 256, MAX_FAMILIES = 64 };

static cn_status open_instance(void **loader, cn_vk_instance *instance)
{
    *loader = dlopen("libvulkan.so.1", RTLD_NOW | RTLD_LOCAL);
    if (!*loader) return cn_fail(CN_ERR_TOOL, "the Vulkan loader is not installed (Debian: libvulkan1)");
    PFN_vkGetInstanceProcAddr get;
    void *symbol = dlsym(*loader, "vkGetInstanceProcAddr");
    memcpy(&get, &symbol, sizeof get);
    PFN_vkEnumerateInstanceVersion ask =
        get ? (PFN_vkEnumerateInstanceVersion)get(NULL, "vkEnumerateInstanceVersion") : NULL;
    PFN_vkCreateInstance create = get ? (PFN_vkCreateInstance)get(NULL, "vkCreateInstance") : NULL;
    uint32_t version = 0;
    if (!ask || !create || ask(&version) != VK_SUCCESS || version < VK_API_VERSION_1_3)
        return cn_fail(CN_ERR_TOOL, "the Vulkan loader has version %u.%u; 1.3 is needed", VK_API_VERSION_MAJOR(version),
                       VK_API_VERSION_MINOR(version));
    const VkApplicationInfo about = { .sType = VK_STRUCTURE_TYPE_APPLICATION_INFO,
                                      .pApplicationName = "conurb",
                                      .apiVersion = VK_API_VERSION_1_3 };
    const VkInstanceCreateInfo info = { .sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, .pApplicationInfo = &about };
    const VkResult result = create(&info, NULL, &instance->handle);
    if (result != VK_SUCCESS) return cn_fail(CN_ERR_TOOL, "Vulkan has no driver here (error %d)", (int)result);
#define LOAD(name) instance->name = (PFN_vk##name)get(instance->handle, "vk" #name);
    CN_VK_INSTANCE(LOAD)
#undef LOAD
    return CN_OK;
}

/* One instance for the whole process, never destroyed: drivers leak memory each time they are unloaded. */
static cn_status find_instance(const cn_vk_instance **found)
{
    static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
    static cn_vk_instance instance;
    static void *loader;
    cn_status status = CN_OK;
    pthread_mutex_lock(&lock);
    if (!instance.handle) status = open_instance(&loader, &instance);
    if (status != CN_OK && loader) {
        dlclose(loader);
        loader = NULL;
    }
    pthread_mutex_unlock(&lock);
    *found = &instance;
    return status;
}

/* The first queue family with compute, or UINT32_MAX. */
static uint32_t compute_family(const cn_vk_instance *instance, VkPhysicalDevice device)
{
    VkQueueFamilyProperties family[MAX_FAMILIES];
    uint32_t n = MAX_FAMILIES;
    instance->GetPhysicalDeviceQueueFamilyProperties(device, &n, family);
    for (uint32_t i = 0; i < n; i++)
        if (family[i].queueFlags & VK_QUEUE_COMPUTE_BIT) return i;
    return UINT32_MAX;
}

static bool has_extension(const cn_vk_instance *instance, VkPhysicalDevice device, const char *name)
{
    uint32_t n = 0;
    if (instance->EnumerateDeviceExtensionProperties(device, NULL, &n, NULL) != VK_SUCCESS || !n) return false;
    VkExtensionProperties *list = calloc(n, sizeof *list);
    bool has = false;
    if (list && instance->EnumerateDeviceExtensionProperties(device, NULL, &n, list) >= VK_SUCCESS)
        for (uint32_t i = 0; i < n; i++)
            has = has || strcmp(list[i].extensionName, name) == 0;
    free(list);
    return has;
}

/* The device's own memory, and what this process may still use of it (VK_EXT_memory_budget). */
static void measure_memory(const cn_vk_instance *instance, VkPhysicalDevice device, cn_device_info *info)
{
    VkPhysicalDeviceMemoryBudgetPropertiesEXT budget = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MEMORY_BUDGET_PROPERTIES_EXT
    };
    const bool told = has_extension(instance, device, VK_EXT_MEMORY_BUDGET_EXTENSION_NAME);
    VkPhysicalDeviceMemoryProperties2 memory = { .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MEMORY_PROPERTIES_2,
                                                 .pNext = told ? &budget : NULL };
    instance->GetPhysicalDeviceMemoryProperties2(device, &memory);
    info->bytes = info->free_bytes = 0;
    for (uint32_t i = 0; i < memory.memoryProperties.memoryHeapCount; i++) {
        const VkMemoryHeap *heap = &memory.memoryProperties.memoryHeaps[i];
        if (!(heap->flags & VK_MEMORY_HEAP_DEVICE_LOCAL_BIT)) continue;
        const uint64_t left =
            budget.heapBudget[i] > budget.heapUsage[i] ? budget.heapBudget[i] - budget.heapUsage[i] : 0;
        info->bytes += heap->size;
        info->free_bytes += told && left < heap->size ? left : heap->size;
    }
}

static void describe(const cn_vk_instance *instance, VkPhysicalDevice device, cn_device_info *info)
{
    VkPhysicalDeviceProperties p;
    instance->GetPhysicalDeviceProperties(device, &p);
    *info = (cn_device_info){ .version = { VK_API_VERSION_MAJOR(p.apiVersion), VK_API_VERSION_MINOR(p.apiVersion),
                                           VK_API_VERSION_PATCH(p.apiVersion) },
                              .software = p.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU,
                              .discrete = p.deviceType == VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU };
    snprintf(info->name, sizeof info->name, "%s", p.deviceName);
    measure_memory(instance, device, info);
    info->fit = p.apiVersion >= VK_API_VERSION_1_3 && p.limits.maxPerStageDescriptorStorageBuffers >= WANTED_BUFFERS &&
                p.limits.maxComputeSharedMemorySize >= WANTED_SHARED &&
                p.limits.maxComputeWorkGroupInvocations >= WANTED_THREADS &&
                compute_family(instance, device) != UINT32_MAX;
}

static cn_status enumerate(const cn_vk_instance *instance, VkPhysicalDevice found[CN_DEVICE_MAX],
                           cn_device_info list[CN_DEVICE_MAX], uint32_t *n)
{
    *n = CN_DEVICE_MAX;
    const VkResult result = instance->EnumeratePhysicalDevices(instance->handle, n, found);
    if ((result != VK_SUCCESS && result != VK_INCOMPLETE) || !*n)
        return cn_fail(CN_ERR_TOOL, "Vulkan finds no device here");
    for (uint32_t i = 0; i < *n; i++)
        describe(instance, found[i], &list[i]);
    return CN_OK;
}

cn_status cn_vulkan_list(cn_device_info list[CN_DEVICE_MAX], uint32_t *n)
{
    const cn_vk_instance *instance;
    VkPhysicalDevice found[CN_DEVICE_MAX];
    *n = 0;
    CN_TRY(find_instance(&instance));
    return enumerate(instance, found, list, n);
}

static cn_status choose(const cn_device_info *list, uint32_t n, long wanted, uint32_t *index)
{
    for (int any = 0; wanted < 0 && any < 2; any++)
        for (uint32_t i = 0; i < n; i++)
            if (list[i].fit && !list[i].software && (any || list[i].discrete)) {
                *index = i;
                return CN_OK;
            }
    if (wanted < 0)
        return cn_fail(CN_ERR_TOOL, "Vulkan finds no graphics processor here (%s); see conurb doctor",
                       list[0].software ? "only software devices" : "no device has what Conurb needs");
    if (wanted >= (long)n)
        return cn_fail(CN_ERR_TOOL, "there is no device gpu:%ld; Vulkan finds %u; see conurb doctor", wanted, n);
    if (!list[wanted].fit)
        return cn_fail(CN_ERR_TOOL, "%s does not have Vulkan 1.3 with %d storage buffers and %d threads of a group",
                       list[wanted].name, WANTED_BUFFERS, WANTED_THREADS);
    *index = (uint32_t)wanted;
    return CN_OK;
}

void cn_vulkan_close(cn_device *base)
{
    cn_vulkan *device = (cn_vulkan *)base;
    if (device->handle) device->DestroyDevice(device->handle, NULL);
    pthread_mutex_destroy(&device->lock);
    free(device);
}

uint64_t cn_vulkan_available(cn_device *base)
{
    const cn_vk_instance *instance;
    cn_device_info now = base->info;
    if (find_instance(&instance) == CN_OK) measure_memory(instance, ((cn_vulkan *)base)->physical, &now);
    return now.free_bytes < base->info.bytes ? now.free_bytes : base->info.bytes;
}

/* What shaders can reach of one buffer, and what can be allocated for it. */
static uint64_t largest_buffer(const cn_vk_instance *instance, VkPhysicalDevice device)
{
    VkPhysicalDeviceVulkan11Properties more = { .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_1_PROPERTIES };
    VkPhysicalDeviceProperties2 all = { .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &more };
    instance->GetPhysicalDeviceProperties2(device, &all);
    const uint64_t range = all.properties.limits.maxStorageBufferRange;
    return more.maxMemoryAllocationSize < range ? more.maxMemoryAllocationSize : range;
}

static cn_status open_device(cn_vulkan *device, long wanted)
{
    VkPhysicalDevice found[CN_DEVICE_MAX];
    cn_device_info list[CN_DEVICE_MAX];
    uint32_t n, index = 0;
    const cn_vk_instance *instance;
    CN_TRY(find_instance(&instance));
    CN_TRY(enumerate(instance, found, list, &n));
    CN_TRY(choose(list, n, wanted, &index));
    device->base.info = list[index];
    device->physical = found[index];
    instance->GetPhysicalDeviceProperties(found[index], &device->properties);
    device->block_bytes = largest_buffer(instance, found[index]);
    instance->GetPhysicalDeviceMemoryProperties(found[index], &device->heaps);
    device->family = compute_family(instance, found[index]);
    const float priority = 1;
    const VkDeviceQueueCreateInfo queue = { .sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
                                            .queueFamilyIndex = device->family,
                                            .queueCount = 1,
                                            .pQueuePriorities = &priority };
    /* Every Vulkan 1.3 device has it: the group size is a specialisation constant. */
    const VkPhysicalDeviceVulkan13Features features = { .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES,
                                                        .maintenance4 = VK_TRUE };
    const VkDeviceCreateInfo info = { .sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                                      .pNext = &features,
                                      .queueCreateInfoCount = 1,
                                      .pQueueCreateInfos = &queue };
    CN_VK_TRY(device, instance->CreateDevice(found[index], &info, NULL, &device->handle), "open");
#define LOAD(name) device->name = (PFN_vk##name)instance->GetDeviceProcAddr(device->handle, "vk" #name);
    CN_VK_DEVICE(LOAD)
#undef LOAD
    device->GetDeviceQueue(device->handle, device->family, 0, &device->queue);
    return CN_OK;
}

cn_status cn_vulkan_open(long which, cn_device **out)
{
    cn_vulkan *device = calloc(1, sizeof *device);
    *out = NULL;
    if (!device) return cn_fail(CN_ERR_NOMEM, "out of memory");
    pthread_mutex_init(&device->lock, NULL);
    const cn_status status = open_device(device, which);
    if (status != CN_OK)
        cn_vulkan_close(&device->base);
    else
        *out = &device->base;
    return status;
}

cn_status cn_device_failed(cn_vulkan *device, VkResult result, const char *what)
{
    if (result == VK_ERROR_DEVICE_LOST) {
        __atomic_store_n(&device->base.lost, true, __ATOMIC_RELAXED);
        return cn_fail(CN_ERR_TOOL, "%s was lost", device->base.info.name);
    }
    if (result == VK_ERROR_OUT_OF_DEVICE_MEMORY || result == VK_ERROR_OUT_OF_HOST_MEMORY)
        return cn_fail(CN_ERR_NOMEM, "%s has not enough memory to %s", device->base.info.name, what);
    return cn_fail(CN_ERR_TOOL, "%s could not %s (Vulkan's error %d)", device->base.info.name, what, (int)result);
}
