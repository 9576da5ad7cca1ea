#include "device/pipeline.h"

#include "begin.spv.h"
#include "march.spv.h"
#include "encode.spv.h"
#include "density.spv.h"
#include "composite.spv.h"
#include "colour.spv.h"
#include "gather.spv.h"
#include "sky.spv.h"

#include <stddef.h>

typedef struct shader {
    const uint32_t *code;
    size_t size;
} shader;
#define SHADER(name)                                                                                                   \
    {                                                                                                                  \
        cn_spirv_##name, sizeof cn_spirv_##name                                                                        \
    }
static const shader shaders[CN_TRACER_PASSES] = { SHADER(begin),     SHADER(march),  SHADER(encode), SHADER(density),
                                                  SHADER(composite), SHADER(colour), SHADER(gather), SHADER(sky) };

static cn_status make_layouts(cn_vulkan *device, cn_tracer_pipelines *p)
{
    VkDescriptorSetLayoutBinding binding[CN_TRACER_BUFFERS];
    for (uint32_t i = 0; i < CN_TRACER_BUFFERS; i++)
        binding[i] = (VkDescriptorSetLayoutBinding){ .binding = i,
                                                     .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                                     .descriptorCount = 1,
                                                     .stageFlags = VK_SHADER_STAGE_COMPUTE_BIT };
    const VkDescriptorSetLayoutCreateInfo set = { .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO,
                                                  .bindingCount = CN_TRACER_BUFFERS,
                                                  .pBindings = binding };
    CN_VK_TRY(device, device->CreateDescriptorSetLayout(device->handle, &set, NULL, &p->set_layout), "lay out buffers");
    const VkPushConstantRange range = { VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof(cn_tracer_push) };
    const VkPipelineLayoutCreateInfo layout = { .sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                                .setLayoutCount = 1,
                                                .pSetLayouts = &p->set_layout,
                                                .pushConstantRangeCount = 1,
                                                .pPushConstantRanges = &range };
    CN_VK_TRY(device, device->CreatePipelineLayout(device->handle, &layout, NULL, &p->layout), "lay out buffers");
    return CN_OK;
}

static cn_status make_pipeline(cn_vulkan *device, const shader *s, const cn_tracer_sizes *sizes,
                               const cn_tracer_pipelines *p, VkPipeline *pipeline)
{
    const VkShaderModuleCreateInfo code = { .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO,
                                            .codeSize = s->size,
                                            .pCode = s->code };
    VkShaderModule module;
    CN_VK_TRY(device, device->CreateShaderModule(device->handle, &code, NULL, &module), "take a shader");
    const VkSpecializationMapEntry entry[] = { { 0, offsetof(cn_tracer_sizes, lanes), sizeof(uint32_t) },
                                               { 1, offsetof(cn_tracer_sizes, rows), sizeof(uint32_t) },
                                               { 2, offsetof(cn_tracer_sizes, round), sizeof(uint32_t) } };
    const VkSpecializationInfo constants = { sizeof entry / sizeof *entry, entry, sizeof *sizes, sizes };
    const VkComputePipelineCreateInfo info = { .sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
                                               .stage = { .sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                          .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                                                          .module = module,
                                                          .pName = "main",
                                                          .pSpecializationInfo = &constants },
                                               .layout = p->layout };
    const VkResult result = device->CreateComputePipelines(device->handle, VK_NULL_HANDLE, 1, &info, NULL, pipeline);
    device->DestroyShaderModule(device->handle, module, NULL);
    CN_VK_TRY(device, result, "compile a shader");
    return CN_OK;
}

cn_status cn_tracer_pipelines_create(cn_vulkan *device, const cn_tracer_sizes *sizes, cn_tracer_pipelines *p)
{
    *p = (cn_tracer_pipelines){ 0 };
    CN_TRY(make_layouts(device, p));
    for (int i = 0; i < CN_TRACER_PASSES; i++)
        CN_TRY(make_pipeline(device, &shaders[i], sizes, p, &p->op[i]));
    return CN_OK;
}

void cn_tracer_pipelines_destroy(cn_vulkan *device, cn_tracer_pipelines *p)
{
    for (int i = 0; i < CN_TRACER_PASSES; i++)
        if (p->op[i]) device->DestroyPipeline(device->handle, p->op[i], NULL);
    if (p->layout) device->DestroyPipelineLayout(device->handle, p->layout, NULL);
    if (p->set_layout) device->DestroyDescriptorSetLayout(device->handle, p->set_layout, NULL);
    *p = (cn_tracer_pipelines){ 0 };
}

cn_status cn_tracer_bindings_create(cn_vulkan *device, const cn_tracer_pipelines *p, uint32_t n_parts,
                                    cn_tracer_bindings *bindings)
{
    *bindings = (cn_tracer_bindings){ 0 };
    const VkDescriptorPoolSize size = { VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, n_parts * CN_TRACER_BUFFERS };
    const VkDescriptorPoolCreateInfo pool = { .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO,
                                              .maxSets = n_parts,
                                              .poolSizeCount = 1,
                                              .pPoolSizes = &size };
    CN_VK_TRY(device, device->CreateDescriptorPool(device->handle, &pool, NULL, &bindings->pool), "bind buffers");
    for (uint32_t i = 0; i < n_parts; i++) {
        const VkDescriptorSetAllocateInfo set = { .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                                  .descriptorPool = bindings->pool,
                                                  .descriptorSetCount = 1,
                                                  .pSetLayouts = &p->set_layout };
        CN_VK_TRY(device, device->AllocateDescriptorSets(device->handle, &set, &bindings->set[i]), "bind buffers");
    }
    return CN_OK;
}

void cn_tracer_bindings_set(cn_vulkan *device, const cn_tracer_bindings *bindings, uint32_t part,
                            const cn_device_buffer buffers[CN_TRACER_BUFFERS])
{
    VkDescriptorBufferInfo info[CN_TRACER_BUFFERS];
    VkWriteDescriptorSet write[CN_TRACER_BUFFERS];
    for (uint32_t i = 0; i < CN_TRACER_BUFFERS; i++) {
        info[i] = (VkDescriptorBufferInfo){ buffers[i].handle, 0, VK_WHOLE_SIZE };
        write[i] = (VkWriteDescriptorSet){ .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                           .dstSet = bindings->set[part],
                                           .dstBinding = i,
                                           .descriptorCount = 1,
                                           .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                           .pBufferInfo = &info[i] };
    }
    device->UpdateDescriptorSets(device->handle, CN_TRACER_BUFFERS, write, 0, NULL);
}

void cn_tracer_bindings_destroy(cn_vulkan *device, cn_tracer_bindings *bindings)
{
    if (bindings->pool) device->DestroyDescriptorPool(device->handle, bindings->pool, NULL);
    *bindings = (cn_tracer_bindings){ 0 };
}
