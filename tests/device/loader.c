/* A Vulkan loader for tests: libvulkan.so.1, for LD_LIBRARY_PATH. It hands on to the real one, whose path is in
 * CONURB_TEST_LOADER, and changes what the program sees:
 *   CONURB_TEST_VERSION=N   Vulkan 1.N
 *   CONURB_TEST_DEVICES=N   every device N times
 *   CONURB_TEST_HARDWARE=1  software devices say that they are not
 *   CONURB_TEST_MB=N        no device has more than N MB of memory
 *   CONURB_TEST_BUDGET_KB=N devices have N KB of memory (VK_EXT_memory_budget); what was allocated stays in use
 *   CONURB_TEST_UNCACHED=1  the processor caches no memory of the devices
 *   CONURB_TEST_MOST_KB=N   no more than N KB can be allocated at once
 *   CONURB_TEST_LOSE=N      the device is lost after N submissions */
#define VK_NO_PROTOTYPES
#include <dlfcn.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <vulkan/vulkan_core.h>

static PFN_vkGetInstanceProcAddr real;
static PFN_vkGetDeviceProcAddr real_of_device;
static VkInstance instance;
static int submissions;
static uint64_t allocated;

static long setting(const char *name)
{
    const char *value = getenv(name);
    return value ? atol(value) : 0;
}

#define REAL(name) ((PFN_vk##name)real(instance, "vk" #name))

static VKAPI_ATTR VkResult VKAPI_CALL version(uint32_t *out)
{
    *out = VK_MAKE_API_VERSION(0, 1, (uint32_t)setting("CONURB_TEST_VERSION"), 0);
    return VK_SUCCESS;
}

static VKAPI_ATTR VkResult VKAPI_CALL create(const VkInstanceCreateInfo *info, const VkAllocationCallbacks *memory,
                                             VkInstance *out)
{
    const VkResult result = ((PFN_vkCreateInstance)real(NULL, "vkCreateInstance"))(info, memory, out);
    instance = result == VK_SUCCESS ? *out : NULL;
    return result;
}

static VKAPI_ATTR VkResult VKAPI_CALL enumerate(VkInstance of, uint32_t *n, VkPhysicalDevice *out)
{
    VkPhysicalDevice found[16];
    uint32_t n_found = 16, wanted = (uint32_t)setting("CONURB_TEST_DEVICES"), all;
    const VkResult result = REAL(EnumeratePhysicalDevices)(of, &n_found, found);
    if (result != VK_SUCCESS) return result;
    all = n_found * wanted;
    for (uint32_t i = 0; out && i < all && i < *n; i++)
        out[i] = found[i % n_found];
    *n = out && *n < all ? *n : all;
    return VK_SUCCESS;
}

static VKAPI_ATTR void VKAPI_CALL describe(VkPhysicalDevice device, VkPhysicalDeviceProperties *out)
{
    REAL(GetPhysicalDeviceProperties)(device, out);
    out->deviceType = VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU;
}

static void change_memory(VkPhysicalDeviceMemoryProperties *m)
{
    const uint64_t most = (uint64_t)setting("CONURB_TEST_MB") * 1000000;
    for (uint32_t i = 0; most && i < m->memoryHeapCount; i++)
        if (m->memoryHeaps[i].size > most) m->memoryHeaps[i].size = most;
    for (uint32_t i = 0; setting("CONURB_TEST_UNCACHED") && i < m->memoryTypeCount; i++)
        m->memoryTypes[i].propertyFlags &= ~(VkMemoryPropertyFlags)VK_MEMORY_PROPERTY_HOST_CACHED_BIT;
}

static VKAPI_ATTR void VKAPI_CALL heaps(VkPhysicalDevice device, VkPhysicalDeviceMemoryProperties *out)
{
    REAL(GetPhysicalDeviceMemoryProperties)(device, out);
    change_memory(out);
}

static VKAPI_ATTR void VKAPI_CALL heaps2(VkPhysicalDevice device, VkPhysicalDeviceMemoryProperties2 *out)
{
    REAL(GetPhysicalDeviceMemoryProperties2)(device, out);
    change_memory(&out->memoryProperties);
    for (VkBaseOutStructure *p = out->pNext; p && setting("CONURB_TEST_BUDGET_KB"); p = p->pNext) {
        if (p->sType != VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MEMORY_BUDGET_PROPERTIES_EXT) continue;
        VkPhysicalDeviceMemoryBudgetPropertiesEXT *budget = (VkPhysicalDeviceMemoryBudgetPropertiesEXT *)(void *)p;
        for (uint32_t i = 0; i < VK_MAX_MEMORY_HEAPS; i++) {
            budget->heapBudget[i] = (VkDeviceSize)setting("CONURB_TEST_BUDGET_KB") * 1000;
            budget->heapUsage[i] = __atomic_load_n(&allocated, __ATOMIC_RELAXED);
        }
    }
}

/* The device's extensions, and VK_EXT_memory_budget. */
static VKAPI_ATTR VkResult VKAPI_CALL extensions(VkPhysicalDevice device, const char *layer, uint32_t *n,
                                                 VkExtensionProperties *out)
{
    uint32_t found = out ? *n - 1 : 0;
    const VkResult result = REAL(EnumerateDeviceExtensionProperties)(device, layer, &found, out);
    if (out) {
        out[found] = (VkExtensionProperties){ .specVersion = VK_EXT_MEMORY_BUDGET_SPEC_VERSION };
        strcpy(out[found].extensionName, VK_EXT_MEMORY_BUDGET_EXTENSION_NAME);
    }
    *n = found + 1;
    return result;
}

static VKAPI_ATTR VkResult VKAPI_CALL allocate(VkDevice device, const VkMemoryAllocateInfo *info,
                                               const VkAllocationCallbacks *memory, VkDeviceMemory *out)
{
    const VkDeviceSize most = (VkDeviceSize)setting("CONURB_TEST_MOST_KB") * 1000;
    if (most && info->allocationSize > most) return VK_ERROR_OUT_OF_DEVICE_MEMORY;
    __atomic_fetch_add(&allocated, info->allocationSize, __ATOMIC_RELAXED);
    return ((PFN_vkAllocateMemory)real_of_device(device, "vkAllocateMemory"))(device, info, memory, out);
}

static VKAPI_ATTR VkResult VKAPI_CALL lose(VkQueue queue, uint32_t n, const VkSubmitInfo *info, VkFence fence)
{
    static PFN_vkQueueSubmit submit;
    if (__atomic_fetch_add(&submissions, 1, __ATOMIC_RELAXED) >= (int)setting("CONURB_TEST_LOSE"))
        return VK_ERROR_DEVICE_LOST;
    if (!submit) submit = REAL(QueueSubmit);
    return submit(queue, n, info, fence);
}

typedef struct changed {
    const char *name, *when;
    PFN_vkVoidFunction by;
} changed;

static PFN_vkVoidFunction change(const changed *list, size_t n, const char *name)
{
    for (size_t i = 0; i < n; i++)
        if (strcmp(list[i].name, name) == 0 && getenv(list[i].when)) return list[i].by;
    return NULL;
}
#define F(function) ((PFN_vkVoidFunction)(function))
#define CHANGE(list, name) change(list, sizeof(list) / sizeof *(list), name)

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL of_device(VkDevice device, const char *name)
{
    const changed list[] = { { "vkQueueSubmit", "CONURB_TEST_LOSE", F(lose) },
                             { "vkAllocateMemory", "CONURB_TEST_LOADER", F(allocate) } };
    const PFN_vkVoidFunction by = CHANGE(list, name);
    return by ? by : real_of_device(device, name);
}

__attribute__((visibility("default"))) VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL vkGetInstanceProcAddr(VkInstance of,
                                                                                                      const char *name)
{
    const changed list[] = { { "vkCreateInstance", "CONURB_TEST_LOADER", F(create) },
                             { "vkEnumerateInstanceVersion", "CONURB_TEST_VERSION", F(version) },
                             { "vkEnumeratePhysicalDevices", "CONURB_TEST_DEVICES", F(enumerate) },
                             { "vkGetPhysicalDeviceProperties", "CONURB_TEST_HARDWARE", F(describe) },
                             { "vkGetPhysicalDeviceMemoryProperties", "CONURB_TEST_LOADER", F(heaps) },
                             { "vkGetPhysicalDeviceMemoryProperties2", "CONURB_TEST_LOADER", F(heaps2) },
                             { "vkEnumerateDeviceExtensionProperties", "CONURB_TEST_BUDGET_KB", F(extensions) },
                             { "vkGetDeviceProcAddr", "CONURB_TEST_LOADER", F(of_device) } };
    if (!real) {
        void *loader = dlopen(getenv("CONURB_TEST_LOADER"), RTLD_NOW | RTLD_LOCAL);
        void *symbol = loader ? dlsym(loader, "vkGetInstanceProcAddr") : NULL;
        memcpy(&real, &symbol, sizeof real);
        if (!real) return NULL;
    }
    if (strcmp(name, "vkGetDeviceProcAddr") == 0) real_of_device = (PFN_vkGetDeviceProcAddr)real(of, name);
    const PFN_vkVoidFunction by = CHANGE(list, name);
    return by ? by : real(of, name);
}
