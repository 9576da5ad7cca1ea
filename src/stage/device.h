/* The devices of a stage: the choice of city.yaml, and work on several devices at once. */
#ifndef CONURB_STAGE_DEVICE_H
#define CONURB_STAGE_DEVICE_H
#include "city/workspace.h"
#include "conurb/device.h"

/* Opens what train.device of city.yaml names, where the caller has chosen nothing, or "auto"; else *device is NULL. A
 * device that is not there is no error: a warning says that the processor does the work. The caller destroys it.
 * CN_ERR_CONFIG: the key names no device. */
CN_NODISCARD cn_status cn_stage_device(const cn_context *ctx, const cn_city *city, cn_device **device);

/* Does the items from 0 to n - 1, one on each device of the context at a time, in order, each with its share of the
 * threads. The callbacks of ctx run on the caller's thread. When an item fails, no further one begins, and the first
 * failure is returned. With one device, all happens on the caller's thread. */
typedef cn_status cn_device_work(void *user, const cn_context *ctx, uint32_t item);
CN_NODISCARD cn_status cn_devices_run(const cn_context *ctx, uint32_t n, cn_device_work *work, void *user);
#endif
