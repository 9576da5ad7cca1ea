/* The compute pipelines of a tracer: one for each operation, all with the same bindings and sizes. */
#ifndef CONURB_DEVICE_PIPELINE_H
#define CONURB_DEVICE_PIPELINE_H
#include "device/passes.h"
#include "device/vulkan.h"

/* As in shader/common.glsl. */
typedef struct cn_tracer_push {
    uint32_t max_rays, levels, enc_rows, density_width, colour_width, columns, parity, phase;
    float ratio, step, inv_extent, min_transmittance, depth_left, min_weight;
    uint32_t lanes, softplus;
} cn_tracer_push;

typedef struct cn_tracer_pipelines {
    VkDescriptorSetLayout set_layout;
    VkPipelineLayout layout;
    VkDescriptorPool pool;
    VkDescriptorSet set;
    VkPipeline op[CN_TRACER_PASSES];
} cn_tracer_pipelines;

/* lanes: threads of a group in the networks, whose widest layer has `rows`. */
CN_NODISCARD cn_status cn_tracer_pipelines_create(cn_vulkan *device, uint32_t lanes, uint32_t rows,
                                                  const cn_device_buffer buffers[CN_TRACER_BUFFERS],
                                                  cn_tracer_pipelines *pipelines);
void cn_tracer_pipelines_destroy(cn_vulkan *device, cn_tracer_pipelines *pipelines);
#endif
