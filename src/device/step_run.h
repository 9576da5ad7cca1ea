/* The operations of a training step on a Vulkan device. Private to device/. */
#ifndef CONURB_DEVICE_STEP_RUN_H
#define CONURB_DEVICE_STEP_RUN_H
#include "device/step.h"
#include "device/vulkan.h"

/* Runs a chain of operations of a training step, one after the other. What the device cannot do runs on the processor,
 * and the log says so once. */
CN_NODISCARD cn_status cn_step_run(cn_vulkan *device, const cn_context *ctx, const cn_chain *chain);
/* As in cn_device_type. */
CN_NODISCARD cn_status cn_step_fetch(cn_device *device, const cn_step_batch *step);
CN_NODISCARD cn_status cn_step_forget(cn_device *device, const cn_step_batch *step);
/* Closes the trainings whose arrays are in this memory; all of them when it is NULL. */
void cn_step_close(cn_vulkan *device, const cn_arena *memory);
#endif
