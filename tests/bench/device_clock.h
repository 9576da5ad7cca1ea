/* Times the passes of a Vulkan device by the device's own clock: it stands between the device's code and the driver,
 * and writes a timestamp before and after each dispatch. */
#ifndef CONURB_BENCH_DEVICE_CLOCK_H
#define CONURB_BENCH_DEVICE_CLOCK_H
#include "device/vulkan.h"

enum { BENCH_DISPATCHES = 1 << 15 }; /* timed ones; later ones are not */

/* Begins and ends the timing of dispatches. CN_ERR_TOOL: the device has no clock. One device at a time. */
CN_NODISCARD cn_status bench_clock_open(cn_vulkan *device);
void bench_clock_close(void);
/* While `on`, dispatches are timed. `begin` forgets what was timed before. */
void bench_clock_begin(void);
/* Waits for the dispatches, which must have been submitted, and ends the timing. Seconds of all dispatches of this
 * pipeline, or of every one for VK_NULL_HANDLE. */
CN_NODISCARD cn_status bench_clock_end(void);
double bench_clock_sum(VkPipeline pipeline);
/* The pipeline that was made as number i since bench_clock_open. VK_NULL_HANDLE: there was none. */
VkPipeline bench_clock_made(uint32_t i);
uint32_t bench_clock_count(void);
#endif
