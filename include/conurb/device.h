/* conurb/device.h: what computes. The processor is a device; graphics processors are others, by Vulkan 1.3 compute. A
 * context names its device (cn_context.device); without one, or where a device cannot do something, the processor does
 * the work. Results are the same within rounding. */
#ifndef CONURB_DEVICE_H
#define CONURB_DEVICE_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_device_info {
    char name[256];
    uint32_t version[3]; /* of Vulkan; 0 for the processor */
    uint64_t bytes;      /* of its own memory */
    bool software;       /* the processor plays it */
    bool fit;            /* has Vulkan 1.3 and what Conurb asks for */
} cn_device_info;

enum { CN_DEVICE_MAX = 16 };
/* Lists the graphics processors of this machine (at most CN_DEVICE_MAX): the index is the N of gpu:N. CN_ERR_TOOL, with
 * the reason in cn_error_message(), when there is no Vulkan loader or no driver. */
CN_API CN_NODISCARD cn_status cn_device_list(cn_device_info list[CN_DEVICE_MAX], uint32_t *n);

/* choice: NULL, "" or "cpu" is the processor; "gpu" the first fit device that is no software; "gpu:N" that of
 * the list, software too. CN_ERR_USAGE for another text, CN_ERR_TOOL where no such device is there. Caller destroys. A
 * device may be used from several threads at once. */
CN_API CN_NODISCARD cn_status cn_device_create(const char *choice, cn_device **device);
CN_API void cn_device_destroy(cn_device **device);
/* Lives as long as the device. */
CN_API const cn_device_info *cn_device_about(const cn_device *device);

#ifdef __cplusplus
}
#endif
#endif
