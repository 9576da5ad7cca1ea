#include "device/step_passes.h"

#include "step_draw.spv.h"
#include "step_depths.spv.h"
#include "step_move.spv.h"
#include "step_march.spv.h"
#include "step_lay_out.spv.h"
#include "step_place.spv.h"
#include "step_encode.spv.h"
#include "step_condition.spv.h"
#include "step_logits.spv.h"
#include "step_live.spv.h"
#include "step_support.spv.h"
#include "step_forward.spv.h"
#include "step_pixel.spv.h"
#include "step_effects.spv.h"
#include "step_samples.spv.h"
#include "step_backward.spv.h"
#include "step_columns.spv.h"
#include "step_position.spv.h"
#include "step_rays.spv.h"
#include "step_weight_grad.spv.h"
#include "step_row_grad.spv.h"
#include "step_head_grad.spv.h"
#include "step_feature_grad.spv.h"
#include "step_sums.spv.h"
#include "step_adam.spv.h"
#include "step_derive.spv.h"
#include "step_project.spv.h"
#include "step_effect_derive.spv.h"
#include "step_table_grad.spv.h"
#include "step_table_adam.spv.h"
#include "step_visits.spv.h"
#include "step_occupancy.spv.h"
#include "step_open.spv.h"
#include "step_support_last.spv.h"
#include "step_support_count.spv.h"
#include "step_support_update.spv.h"

typedef struct shader {
    const uint32_t *code;
    size_t size;
} shader;
#define SHADER(name)                                                                                                   \
    {                                                                                                                  \
        cn_spirv_##name, sizeof cn_spirv_##name                                                                        \
    }
/* In the order of cn_step_pass. */
static const shader shaders[CN_STEP_PASSES] = {
    SHADER(step_draw),       SHADER(step_depths),       SHADER(step_move),          SHADER(step_march),
    SHADER(step_lay_out),    SHADER(step_place),        SHADER(step_encode),        SHADER(step_condition),
    SHADER(step_logits),     SHADER(step_live),         SHADER(step_support),       SHADER(step_forward),
    SHADER(step_pixel),      SHADER(step_effects),      SHADER(step_samples),       SHADER(step_backward),
    SHADER(step_columns),    SHADER(step_position),     SHADER(step_rays),          SHADER(step_weight_grad),
    SHADER(step_row_grad),   SHADER(step_head_grad),    SHADER(step_feature_grad),  SHADER(step_sums),
    SHADER(step_adam),       SHADER(step_derive),       SHADER(step_project),       SHADER(step_effect_derive),
    SHADER(step_table_grad), SHADER(step_table_adam),   SHADER(step_visits),        SHADER(step_occupancy),
    SHADER(step_open),       SHADER(step_support_last), SHADER(step_support_count), SHADER(step_support_update)
};

#define BIT(array) CN_STEP_BIT(array)
_Static_assert(CN_MAP_BLOCKS == 4, "the shaders bind so many");
#define MAPS CN_OWN_MAPS, CN_OWN_MAPS + 1, CN_OWN_MAPS + 2, CN_OWN_MAPS + 3
/* The bindings are in the order of the shader's. */
const cn_step_pass_about cn_step_about[CN_STEP_PASSES] = {
    [CN_STEP_DRAW] = { "draw",
                       16,
                       { CN_OWN_SETTINGS, CN_STEP_PHOTOS, MAPS, CN_STEP_SPARSE, CN_STEP_SKY_HINTS, CN_OWN_DRAWN,
                         CN_STEP_RAY_PHOTO, CN_STEP_DEPTH, CN_STEP_TARGET, CN_STEP_RAYS, CN_STEP_RAY_UV,
                         CN_STEP_SKY_HINT, CN_STEP_FIRST_T },
                       BIT(CN_STEP_RAY_PHOTO) | BIT(CN_STEP_DEPTH) | BIT(CN_STEP_TARGET) | BIT(CN_STEP_RAYS) |
                           BIT(CN_STEP_RAY_UV) | BIT(CN_STEP_SKY_HINT) | BIT(CN_STEP_FIRST_T) },
    [CN_STEP_DEPTHS] = { "depths",
                         14,
                         { CN_OWN_SETTINGS, CN_STEP_PHOTOS, MAPS, CN_OWN_DRAWN, CN_STEP_RAY_PHOTO, CN_STEP_TARGET,
                           CN_STEP_SKY_HINT, CN_STEP_MEASURED, CN_STEP_PLANE_LOG, CN_STEP_PLANE_WIDTH,
                           CN_STEP_FIRST_T },
                         BIT(CN_STEP_MEASURED) | BIT(CN_STEP_PLANE_LOG) | BIT(CN_STEP_PLANE_WIDTH) |
                             BIT(CN_STEP_FIRST_T) },
    [CN_STEP_MOVE] = { "move",
                       5,
                       { CN_OWN_SETTINGS, CN_STEP_VALUES, CN_STEP_CONSTANTS, CN_STEP_RAY_PHOTO, CN_STEP_RAYS },
                       BIT(CN_STEP_RAYS) },
    [CN_STEP_MARCH] = { "march",
                        10,
                        { CN_OWN_SETTINGS, CN_STEP_RAYS, CN_STEP_FIRST_T, CN_STEP_BITS, CN_STEP_TARGET,
                          CN_STEP_SKY_HINT, CN_STEP_MARCH_T, CN_STEP_RAY_SAMPLES, CN_STEP_GROUP_SAMPLES,
                          CN_STEP_MISSING },
                        BIT(CN_STEP_TARGET) | BIT(CN_STEP_MARCH_T) | BIT(CN_STEP_RAY_SAMPLES) |
                            BIT(CN_STEP_GROUP_SAMPLES) | BIT(CN_STEP_MISSING) },
    [CN_STEP_LAY_OUT] = { "lay out",
                          7,
                          { CN_OWN_SETTINGS, CN_STEP_TARGET, CN_STEP_RAY_SAMPLES, CN_STEP_GROUP_SAMPLES,
                            CN_STEP_GROUP_PANEL, CN_STEP_GROUP_LIVE, CN_STEP_COUNTS },
                          BIT(CN_STEP_GROUP_PANEL) | BIT(CN_STEP_GROUP_LIVE) | BIT(CN_STEP_COUNTS) },
    [CN_STEP_PLACE] = { "place",
                        8,
                        { CN_OWN_SETTINGS, CN_STEP_RAYS, CN_STEP_MARCH_T, CN_STEP_RAY_SAMPLES, CN_STEP_GROUP_SAMPLES,
                          CN_STEP_GROUP_PANEL, CN_STEP_POS, CN_STEP_LENGTH },
                        BIT(CN_STEP_POS) | BIT(CN_STEP_LENGTH) },
    [CN_STEP_ENCODE] = { "encode",
                         6,
                         { CN_OWN_SETTINGS, CN_OWN_LEVELS, CN_STEP_TABLE, CN_STEP_COUNTS, CN_STEP_POS, CN_STEP_ENC },
                         BIT(CN_STEP_ENC) },
    [CN_STEP_CONDITION] = { "condition",
                            5,
                            { CN_OWN_SETTINGS, CN_STEP_VALUES, CN_STEP_RAYS, CN_STEP_RAY_PHOTO, CN_STEP_CONDITIONING },
                            BIT(CN_STEP_CONDITIONING) },
    [CN_STEP_LOGITS] = { "logits",
                         5,
                         { CN_OWN_SETTINGS, CN_STEP_DERIVED, CN_STEP_COUNTS, CN_STEP_ENC, CN_OWN_LOGIT },
                         0 },
    [CN_STEP_LIVE] = { "live",
                       15,
                       { CN_OWN_SETTINGS, CN_OWN_LOGIT, CN_STEP_LENGTH, CN_STEP_RAY_SAMPLES, CN_STEP_GROUP_SAMPLES,
                         CN_STEP_GROUP_PANEL, CN_STEP_POS, CN_STEP_MARCH_T, CN_STEP_GROUP_LIVE, CN_STEP_VISIT_CELL,
                         CN_STEP_VISIT_SEEN, CN_OWN_LIVE, CN_OWN_LIVE_FROM, CN_OWN_SPANS, CN_OWN_PANEL_GROUP },
                       BIT(CN_STEP_GROUP_LIVE) | BIT(CN_STEP_VISIT_CELL) | BIT(CN_STEP_VISIT_SEEN) },
    [CN_STEP_SUPPORT] = { "support",
                          10,
                          { CN_OWN_SETTINGS, CN_STEP_GROUP_SAMPLES, CN_STEP_GROUP_PANEL, CN_STEP_GROUP_LIVE,
                            CN_STEP_POS, CN_OWN_LIVE_FROM, CN_STEP_SUPPORT_SINCE, CN_STEP_SUPPORT_TIMES,
                            CN_STEP_SUPPORT_CELL, CN_OWN_SINGLE_VIEW },
                          BIT(CN_STEP_SUPPORT_CELL) },
    [CN_STEP_FORWARD] = { "forward",
                          13,
                          { CN_OWN_SETTINGS, CN_STEP_DERIVED, CN_STEP_COUNTS, CN_STEP_GROUP_PANEL, CN_STEP_GROUP_LIVE,
                            CN_OWN_PANEL_GROUP, CN_OWN_LIVE_FROM, CN_STEP_ENC, CN_STEP_POS, CN_STEP_CONDITIONING,
                            CN_OWN_LIVE_POS, CN_OWN_ACTS, CN_OWN_COLOUR },
                          0 },
    [CN_STEP_COMPOSITE] = { "pixel",
                            5,
                            { CN_OWN_SETTINGS, CN_OWN_LIVE, CN_OWN_SPANS, CN_OWN_COLOUR, CN_STEP_PIXEL },
                            BIT(CN_STEP_PIXEL) },
    [CN_STEP_EFFECTS] = { "effects",
                          16,
                          { CN_OWN_SETTINGS, CN_STEP_TARGET, CN_STEP_COUNTS, CN_STEP_GROUP_PANEL, CN_STEP_GROUP_SAMPLES,
                            CN_STEP_PIXEL, CN_STEP_VALUES, CN_STEP_CONSTANTS, CN_STEP_RAYS, CN_STEP_RAY_PHOTO,
                            CN_STEP_RAY_UV, CN_STEP_SKY_HINT, CN_STEP_D_PIXEL, CN_OWN_EFFECT_X, CN_OWN_EFFECT_D,
                            CN_OWN_GROUP_SUMS },
                          BIT(CN_STEP_D_PIXEL) },
    [CN_STEP_SAMPLES] = { "samples",
                          16,
                          { CN_OWN_SETTINGS, CN_STEP_TARGET, CN_STEP_COUNTS, CN_OWN_LIVE, CN_OWN_SPANS, CN_OWN_COLOUR,
                            CN_STEP_D_PIXEL, CN_STEP_DEPTH, CN_STEP_MEASURED, CN_STEP_PLANE_LOG, CN_STEP_PLANE_WIDTH,
                            CN_STEP_SKY_HINT, CN_STEP_RAYS, CN_STEP_MISSING, CN_OWN_D_SAMPLE, CN_OWN_SINGLE_VIEW },
                          BIT(CN_STEP_MISSING) },
    [CN_STEP_BACKWARD] = { "backward",
                           12,
                           { CN_OWN_SETTINGS, CN_STEP_VALUES, CN_STEP_COUNTS, CN_STEP_GROUP_PANEL, CN_STEP_GROUP_LIVE,
                             CN_OWN_PANEL_GROUP, CN_OWN_D_SAMPLE, CN_OWN_ACTS, CN_OWN_LIVE_POS, CN_OWN_D_ACTS,
                             CN_STEP_ENC, CN_STEP_POS },
                           BIT(CN_STEP_ENC) | BIT(CN_STEP_POS) },
    [CN_STEP_COLUMNS] = { "columns",
                          4,
                          { CN_OWN_SETTINGS, CN_OWN_SPANS, CN_OWN_D_ACTS, CN_STEP_D_COLUMNS },
                          BIT(CN_STEP_D_COLUMNS) },
    [CN_STEP_POSITION] = { "position",
                           13,
                           { CN_OWN_SETTINGS, CN_OWN_LEVELS, CN_STEP_TABLE, CN_STEP_COUNTS, CN_STEP_GROUP_PANEL,
                             CN_STEP_GROUP_LIVE, CN_OWN_PANEL_GROUP, CN_OWN_LIVE_FROM, CN_OWN_LIVE, CN_STEP_RAYS,
                             CN_STEP_ENC, CN_OWN_LIVE_POS, CN_OWN_D_PLACE },
                           0 },
    [CN_STEP_RAY_GRAD] = { "rays",
                           4,
                           { CN_OWN_SETTINGS, CN_OWN_SPANS, CN_OWN_D_PLACE, CN_STEP_D_RAYS },
                           BIT(CN_STEP_D_RAYS) },
    [CN_STEP_WEIGHT_GRAD] = { "weight grad",
                              6,
                              { CN_OWN_SETTINGS, CN_STEP_GROUP_PANEL, CN_STEP_GROUP_LIVE, CN_OWN_ACTS, CN_OWN_D_ACTS,
                                CN_STEP_SLOT_GRAD },
                              BIT(CN_STEP_SLOT_GRAD) },
    [CN_STEP_ROW_GRAD] = { "row grad",
                           10,
                           { CN_OWN_SETTINGS, CN_STEP_GROUP_PANEL, CN_STEP_GROUP_SAMPLES, CN_STEP_RAY_PHOTO,
                             CN_STEP_CONSTANTS, CN_OWN_EFFECT_D, CN_STEP_D_COLUMNS, CN_STEP_RAYS, CN_STEP_D_RAYS,
                             CN_STEP_SLOT_GRAD },
                           BIT(CN_STEP_SLOT_GRAD) },
    [CN_STEP_HEAD_GRAD] = { "head grad",
                            6,
                            { CN_OWN_SETTINGS, CN_STEP_GROUP_PANEL, CN_STEP_GROUP_SAMPLES, CN_OWN_EFFECT_X,
                              CN_OWN_EFFECT_D, CN_STEP_SLOT_GRAD },
                            BIT(CN_STEP_SLOT_GRAD) },
    [CN_STEP_FEATURE_GRAD] = { "feature grad",
                               7,
                               { CN_OWN_SETTINGS, CN_STEP_GROUP_PANEL, CN_STEP_GROUP_SAMPLES, CN_STEP_RAY_PHOTO,
                                 CN_STEP_RAY_UV, CN_OWN_EFFECT_D, CN_STEP_SLOT_GRAD },
                               BIT(CN_STEP_SLOT_GRAD) },
    [CN_STEP_SUM] = { "sums",
                      7,
                      { CN_OWN_SETTINGS, CN_STEP_GROUP_PANEL, CN_STEP_GROUP_LIVE, CN_STEP_ENC, CN_STEP_SLOT_GRAD,
                        CN_OWN_GROUP_SUMS, CN_STEP_SUMS },
                      BIT(CN_STEP_SUMS) },
    [CN_STEP_ADAM] = { "adam",
                       6,
                       { CN_OWN_SETTINGS, CN_STEP_SLOT_GRAD, CN_STEP_FACTOR, CN_STEP_VALUES, CN_STEP_MOMENT_M,
                         CN_STEP_MOMENT_V },
                       BIT(CN_STEP_VALUES) | BIT(CN_STEP_MOMENT_M) | BIT(CN_STEP_MOMENT_V) },
    [CN_STEP_DERIVE] = { "derive", 3, { CN_OWN_SETTINGS, CN_STEP_VALUES, CN_STEP_DERIVED }, BIT(CN_STEP_DERIVED) },
    [CN_STEP_PROJECT] = { "project",
                          6,
                          { CN_OWN_SETTINGS, CN_STEP_RUN, CN_STEP_CONSTANTS, CN_STEP_TREND, CN_STEP_VALUES,
                            CN_OWN_RUN_MEAN },
                          BIT(CN_STEP_VALUES) },
    [CN_STEP_EFFECT_DERIVE] = { "effect derive",
                                3,
                                { CN_OWN_SETTINGS, CN_STEP_VALUES, CN_STEP_EFFECTS_DERIVED },
                                BIT(CN_STEP_EFFECTS_DERIVED) },
    [CN_STEP_TABLE_GRAD] = { "table grad",
                             8,
                             { CN_OWN_SETTINGS, CN_OWN_LEVELS, CN_STEP_GROUP_PANEL, CN_STEP_GROUP_LIVE, CN_STEP_POS,
                               CN_STEP_ENC, CN_OWN_FIXED, CN_OWN_TOUCHED },
                             0 },
    [CN_STEP_TABLE_ADAM] = { "table adam",
                             6,
                             { CN_OWN_SETTINGS, CN_OWN_LEVELS, CN_STEP_TABLE, CN_STEP_STATE, CN_OWN_FIXED,
                               CN_OWN_TOUCHED },
                             BIT(CN_STEP_TABLE) | BIT(CN_STEP_STATE) },
    [CN_STEP_VISITS] = { "visits",
                         6,
                         { CN_OWN_SETTINGS, CN_STEP_GROUP_SAMPLES, CN_STEP_GROUP_PANEL, CN_STEP_VISIT_CELL,
                           CN_STEP_VISIT_SEEN, CN_OWN_CELL_MOST },
                         0 },
    [CN_STEP_OCCUPANCY] = { "occupancy",
                            8,
                            { CN_OWN_SETTINGS, CN_STEP_GROUP_SAMPLES, CN_STEP_GROUP_PANEL, CN_STEP_VISIT_CELL,
                              CN_OWN_CELL_MOST, CN_STEP_SEEN, CN_STEP_VISITED, CN_STEP_BITS },
                            BIT(CN_STEP_SEEN) | BIT(CN_STEP_VISITED) | BIT(CN_STEP_BITS) },
    [CN_STEP_OPEN] = { "open",
                       6,
                       { CN_OWN_SETTINGS, CN_STEP_MISSING, CN_STEP_RAYS, CN_STEP_OPEN_T, CN_STEP_SEEN, CN_STEP_BITS },
                       BIT(CN_STEP_SEEN) | BIT(CN_STEP_BITS) },
    [CN_STEP_SUPPORT_LAST] = { "support last",
                               8,
                               { CN_OWN_SETTINGS, CN_STEP_RAY_SAMPLES, CN_STEP_GROUP_SAMPLES, CN_STEP_GROUP_PANEL,
                                 CN_STEP_VISIT_SEEN, CN_STEP_SUPPORT_CELL, CN_STEP_RAY_PHOTO, CN_OWN_SUPPORT_LAST },
                               0 },
    [CN_STEP_SUPPORT_COUNT] = { "support count",
                                8,
                                { CN_OWN_SETTINGS, CN_STEP_RAY_SAMPLES, CN_STEP_GROUP_SAMPLES, CN_STEP_GROUP_PANEL,
                                  CN_STEP_VISIT_SEEN, CN_STEP_SUPPORT_CELL, CN_OWN_SUPPORT_LAST, CN_OWN_SUPPORT_COUNT },
                                0 },
    [CN_STEP_SUPPORT_UPDATE] = { "support update",
                                 12,
                                 { CN_OWN_SETTINGS, CN_STEP_RAY_SAMPLES, CN_STEP_GROUP_SAMPLES, CN_STEP_GROUP_PANEL,
                                   CN_STEP_VISIT_SEEN, CN_STEP_SUPPORT_CELL, CN_STEP_RAY_PHOTO, CN_OWN_SUPPORT_LAST,
                                   CN_OWN_SUPPORT_COUNT, CN_STEP_SUPPORT_PHOTO, CN_STEP_SUPPORT_SINCE,
                                   CN_STEP_SUPPORT_TIMES },
                                 BIT(CN_STEP_SUPPORT_PHOTO) | BIT(CN_STEP_SUPPORT_SINCE) | BIT(CN_STEP_SUPPORT_TIMES) },
};
_Static_assert(CN_STEP_ARRAYS <= 64, "a set of arrays is a word of 64 bits");

static cn_status make_layouts(cn_vulkan *device, cn_step_pass pass, cn_step_pipelines *p)
{
    VkDescriptorSetLayoutBinding binding[CN_STEP_BINDINGS];
    const uint32_t n = cn_step_about[pass].n;
    for (uint32_t i = 0; i < n; i++)
        binding[i] = (VkDescriptorSetLayoutBinding){ .binding = i,
                                                     .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                                     .descriptorCount = 1,
                                                     .stageFlags = VK_SHADER_STAGE_COMPUTE_BIT };
    const VkDescriptorSetLayoutCreateInfo set = { .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO,
                                                  .bindingCount = n,
                                                  .pBindings = binding };
    CN_VK_TRY(device, device->CreateDescriptorSetLayout(device->handle, &set, NULL, &p->set_layout[pass]),
              "lay out buffers");
    const VkPipelineLayoutCreateInfo layout = { .sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                                .setLayoutCount = 1,
                                                .pSetLayouts = &p->set_layout[pass] };
    CN_VK_TRY(device, device->CreatePipelineLayout(device->handle, &layout, NULL, &p->layout[pass]), "lay out buffers");
    return CN_OK;
}

static cn_status make_set(cn_vulkan *device, cn_step_pass pass, const cn_device_buffer *buffer, cn_step_pipelines *p)
{
    const cn_step_pass_about *about = &cn_step_about[pass];
    const VkDescriptorSetAllocateInfo set = { .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                              .descriptorPool = p->pool,
                                              .descriptorSetCount = 1,
                                              .pSetLayouts = &p->set_layout[pass] };
    CN_VK_TRY(device, device->AllocateDescriptorSets(device->handle, &set, &p->set[pass]), "bind buffers");
    VkDescriptorBufferInfo info[CN_STEP_BINDINGS];
    VkWriteDescriptorSet write[CN_STEP_BINDINGS];
    for (uint32_t i = 0; i < about->n; i++) {
        info[i] = (VkDescriptorBufferInfo){ buffer[about->binding[i]].handle, 0, VK_WHOLE_SIZE };
        write[i] = (VkWriteDescriptorSet){ .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                           .dstSet = p->set[pass],
                                           .dstBinding = i,
                                           .descriptorCount = 1,
                                           .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                           .pBufferInfo = &info[i] };
    }
    device->UpdateDescriptorSets(device->handle, about->n, write, 0, NULL);
    return CN_OK;
}

static cn_status make_pipeline(cn_vulkan *device, cn_step_pass pass, const uint32_t sizes[2], cn_step_pipelines *p)
{
    const VkShaderModuleCreateInfo code = { .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO,
                                            .codeSize = shaders[pass].size,
                                            .pCode = shaders[pass].code };
    VkShaderModule module;
    CN_VK_TRY(device, device->CreateShaderModule(device->handle, &code, NULL, &module), "take a shader");
    const VkSpecializationMapEntry entry[2] = { { 0, 0, 4 }, { 1, 4, 4 } };
    const VkSpecializationInfo constants = { 2, entry, 2 * sizeof *sizes, sizes };
    const VkComputePipelineCreateInfo info = { .sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
                                               .stage = { .sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                          .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                                                          .module = module,
                                                          .pName = "main",
                                                          .pSpecializationInfo = &constants },
                                               .layout = p->layout[pass] };
    const VkResult result =
        device->CreateComputePipelines(device->handle, VK_NULL_HANDLE, 1, &info, NULL, &p->pipeline[pass]);
    device->DestroyShaderModule(device->handle, module, NULL);
    CN_VK_TRY(device, result, "compile a shader");
    return CN_OK;
}

cn_status cn_step_pipelines_create(cn_vulkan *device, uint32_t lanes, uint32_t rows,
                                   const cn_device_buffer buffer[CN_STEP_BUFFERS], cn_step_pipelines *p)
{
    const uint32_t sizes[2] = { lanes, rows };
    VkDescriptorPoolSize size = { VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 0 };
    for (int i = 0; i < CN_STEP_PASSES; i++)
        size.descriptorCount += cn_step_about[i].n;
    const VkDescriptorPoolCreateInfo pool = { .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO,
                                              .maxSets = CN_STEP_PASSES,
                                              .poolSizeCount = 1,
                                              .pPoolSizes = &size };
    CN_VK_TRY(device, device->CreateDescriptorPool(device->handle, &pool, NULL, &p->pool), "bind buffers");
    for (int i = 0; i < CN_STEP_PASSES; i++) {
        CN_TRY(make_layouts(device, (cn_step_pass)i, p));
        CN_TRY(make_set(device, (cn_step_pass)i, buffer, p));
        CN_TRY(make_pipeline(device, (cn_step_pass)i, sizes, p));
    }
    return CN_OK;
}

void cn_step_pipelines_destroy(cn_vulkan *device, cn_step_pipelines *p)
{
    for (int i = 0; i < CN_STEP_PASSES; i++) {
        if (p->pipeline[i]) device->DestroyPipeline(device->handle, p->pipeline[i], NULL);
        if (p->layout[i]) device->DestroyPipelineLayout(device->handle, p->layout[i], NULL);
        if (p->set_layout[i]) device->DestroyDescriptorSetLayout(device->handle, p->set_layout[i], NULL);
    }
    if (p->pool) device->DestroyDescriptorPool(device->handle, p->pool, NULL);
}
