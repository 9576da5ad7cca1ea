/* The compute pipelines of a tracer, one for each operation, all with the same bindings and sizes; and the bindings. */
#ifndef CONURB_DEVICE_PIPELINE_H
#define CONURB_DEVICE_PIPELINE_H
#include "device/passes.h"
#include "device/trace.h"
#include "device/vulkan.h"

/* As in shader/common.glsl. */
typedef struct cn_tracer_push {
    uint32_t max_rays, parts, part, levels, columns, parity, phase, lanes, n_rays;
    float ratio, step, min_transmittance, depth_left, min_weight;
    uint32_t fine_depth;
} cn_tracer_push;

/* What is fixed when the shaders are compiled, in the order of its numbers: threads of a group in the networks, rows of
 * the widest layer, samples of a ray in a round. */
typedef struct cn_tracer_sizes {
    uint32_t lanes, rows, round;
} cn_tracer_sizes;

typedef struct cn_tracer_pipelines {
    VkDescriptorSetLayout set_layout;
    VkPipelineLayout layout;
    VkPipeline op[CN_TRACER_PASSES];
} cn_tracer_pipelines;
CN_NODISCARD cn_status cn_tracer_pipelines_create(cn_vulkan *device, const cn_tracer_sizes *sizes,
                                                  cn_tracer_pipelines *pipelines);
void cn_tracer_pipelines_destroy(cn_vulkan *device, cn_tracer_pipelines *pipelines);

/* The buffers of a tracer as its passes see them: a set for each part, whose table and weights it has. */
typedef struct cn_tracer_bindings {
    VkDescriptorPool pool;
    VkDescriptorSet set[CN_TRACE_PARTS];
} cn_tracer_bindings;
CN_NODISCARD cn_status cn_tracer_bindings_create(cn_vulkan *device, const cn_tracer_pipelines *pipelines,
                                                 uint32_t n_parts, cn_tracer_bindings *bindings);
void cn_tracer_bindings_set(cn_vulkan *device, const cn_tracer_bindings *bindings, uint32_t part,
                            const cn_device_buffer buffers[CN_TRACER_BUFFERS]);
void cn_tracer_bindings_destroy(cn_vulkan *device, cn_tracer_bindings *bindings);
#endif
