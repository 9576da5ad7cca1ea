/* conurb/device.h: devices that compute. The processor is one device; graphics processors are others, through Vulkan
 * 1.3 compute. cn_context.device names the device of a call. Without one, and for work that a device cannot do, the
 * processor computes. All devices give the same results within rounding. */
#ifndef CONURB_DEVICE_H
#define CONURB_DEVICE_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_device_info {
    char name[256];
    uint32_t version[3]; /* Vulkan version; 0 for the processor */
    uint64_t bytes;      /* its own memory */
    uint64_t free_bytes; /* what of it this process may still use now, where the driver says so; else bytes */
    bool software;       /* a graphics processor emulated on the processor */
    bool discrete;       /* a graphics processor with memory of its own, not a part of the processor */
    bool fit;            /* has Vulkan 1.3 and every feature that Conurb needs */
    bool automatic;      /* was opened as "auto": the choice of a city.yaml comes before it */
} cn_device_info;

enum { CN_DEVICE_MAX = 16 };
/* Lists the graphics processors of this machine, CN_DEVICE_MAX at most. The index in the list is the N of gpu:N.
 * CN_ERR_TOOL: there is no Vulkan loader or no driver; cn_error_message() says which. Any thread. */
CN_API CN_NODISCARD cn_status cn_device_list(cn_device_info list[CN_DEVICE_MAX], uint32_t *n);

/* Opens a device. choice: NULL, "" or "cpu" is the processor; "gpu" is the first fit device that is not software,
 * a discrete one where there is one; "auto" is the same, and the processor where there is none; "gpu:N" is entry N of
 * cn_device_list, software included. A list of these with commas between them, or "gpu:all" for every fit device that
 * is not software, opens several: a call computes on the first, and cn_city_train trains a tile on each at the same
 * time. CN_ERR_USAGE: another text. CN_ERR_TOOL: one of them is not there. The caller destroys the first, which
 * destroys all. Several threads may use one device at the same time. */
CN_API CN_NODISCARD cn_status cn_device_create(const char *choice, cn_device **device);
CN_API void cn_device_destroy(cn_device **device);
/* The next device of the list that was opened; NULL after the last. */
CN_API cn_device *cn_device_next(const cn_device *device);
/* What the device is. Valid until cn_device_destroy. */
CN_API const cn_device_info *cn_device_about(const cn_device *device);

#ifdef __cplusplus
}
#endif
#endif
