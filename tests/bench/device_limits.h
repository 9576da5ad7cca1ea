/* Measures the best that a Vulkan device can do; the passes of training and rendering are compared with it. */
#ifndef CONURB_BENCH_DEVICE_LIMITS_H
#define CONURB_BENCH_DEVICE_LIMITS_H
#include "device/vulkan.h"

typedef struct bench_device_limits {
    double bytes_per_s;   /* read plus written, in order, over far more than a cache holds */
    double flops_per_s;   /* multiply-adds of float in registers */
    double reads_per_s;   /* independent reads of words at random places of a table */
    double updates_per_s; /* atomic additions to words at random places */
} bench_device_limits;

/* table_bytes: size of the table of the random reads and updates. After bench_clock_open. */
CN_NODISCARD cn_status bench_device_measure(cn_vulkan *device, size_t table_bytes, bool quick,
                                            bench_device_limits *limits);
#endif
