#include "device_limits.h"

#include "bench_multiply.spv.h"
#include "bench_random.spv.h"
#include "bench_stream.spv.h"
#include "device_clock.h"

#include <math.h>

enum { THREADS = 64, RUNS = 5 };

typedef struct rig {
    cn_vulkan *device;
    cn_device_stream stream;
    cn_device_buffer buffer[2];
    VkDescriptorSetLayout set_layout;
    VkPipelineLayout layout;
    VkDescriptorPool pool;
    VkDescriptorSet set;
    VkPipeline pipeline;
} rig;

typedef struct program {
    const uint32_t *code;
    size_t size;
    uint32_t constants[2];
    size_t bytes[2]; /* of the buffers */
    uint32_t groups;
} program;

static cn_status bind_buffers(rig *r)
{
    cn_vulkan *d = r->device;
    VkDescriptorSetLayoutBinding binding[2];
    VkDescriptorBufferInfo info[2];
    VkWriteDescriptorSet write[2];
    const VkDescriptorPoolSize size = { VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 2 };
    for (uint32_t i = 0; i < 2; i++)
        binding[i] = (VkDescriptorSetLayoutBinding){ .binding = i,
                                                     .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                                     .descriptorCount = 1,
                                                     .stageFlags = VK_SHADER_STAGE_COMPUTE_BIT };
    const VkDescriptorSetLayoutCreateInfo set_layout = { .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO,
                                                         .bindingCount = 2,
                                                         .pBindings = binding };
    const VkDescriptorPoolCreateInfo pool = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO, .maxSets = 1, .poolSizeCount = 1, .pPoolSizes = &size
    };
    CN_VK_TRY(d, d->CreateDescriptorSetLayout(d->handle, &set_layout, NULL, &r->set_layout), "lay out buffers");
    CN_VK_TRY(d, d->CreateDescriptorPool(d->handle, &pool, NULL, &r->pool), "bind buffers");
    const VkPipelineLayoutCreateInfo layout = { .sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                                .setLayoutCount = 1,
                                                .pSetLayouts = &r->set_layout };
    const VkDescriptorSetAllocateInfo set = { .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                              .descriptorPool = r->pool,
                                              .descriptorSetCount = 1,
                                              .pSetLayouts = &r->set_layout };
    CN_VK_TRY(d, d->CreatePipelineLayout(d->handle, &layout, NULL, &r->layout), "lay out buffers");
    CN_VK_TRY(d, d->AllocateDescriptorSets(d->handle, &set, &r->set), "bind buffers");
    for (uint32_t i = 0; i < 2; i++) {
        info[i] = (VkDescriptorBufferInfo){ r->buffer[i].handle, 0, VK_WHOLE_SIZE };
        write[i] = (VkWriteDescriptorSet){ .sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                           .dstSet = r->set,
                                           .dstBinding = i,
                                           .descriptorCount = 1,
                                           .descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
                                           .pBufferInfo = &info[i] };
    }
    d->UpdateDescriptorSets(d->handle, 2, write, 0, NULL);
    return CN_OK;
}

static cn_status compile(rig *r, const program *p)
{
    cn_vulkan *d = r->device;
    const VkShaderModuleCreateInfo code = { .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO,
                                            .codeSize = p->size,
                                            .pCode = p->code };
    const VkSpecializationMapEntry entry[2] = { { 0, 0, 4 }, { 1, 4, 4 } };
    const VkSpecializationInfo constants = { 2, entry, sizeof p->constants, p->constants };
    VkShaderModule module;
    CN_VK_TRY(d, d->CreateShaderModule(d->handle, &code, NULL, &module), "take a shader");
    const VkComputePipelineCreateInfo info = { .sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
                                               .stage = { .sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                          .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                                                          .module = module,
                                                          .pName = "main",
                                                          .pSpecializationInfo = &constants },
                                               .layout = r->layout };
    const VkResult result = d->CreateComputePipelines(d->handle, VK_NULL_HANDLE, 1, &info, NULL, &r->pipeline);
    d->DestroyShaderModule(d->handle, module, NULL);
    CN_VK_TRY(d, result, "compile a shader");
    return CN_OK;
}

/* The fastest of some runs. */
static cn_status time_runs(rig *r, const program *p, bool quick, double *seconds)
{
    cn_vulkan *d = r->device;
    *seconds = INFINITY;
    for (int i = 0; i < (quick ? 2 : RUNS); i++) {
        CN_TRY(cn_device_stream_begin(&r->stream));
        if (i == 0)
            for (int b = 0; b < 2; b++)
                d->CmdFillBuffer(r->stream.commands, r->buffer[b].handle, 0, VK_WHOLE_SIZE, 0);
        cn_device_stream_barrier(&r->stream);
        bench_clock_begin();
        d->CmdBindPipeline(r->stream.commands, VK_PIPELINE_BIND_POINT_COMPUTE, r->pipeline);
        d->CmdBindDescriptorSets(r->stream.commands, VK_PIPELINE_BIND_POINT_COMPUTE, r->layout, 0, 1, &r->set, 0, NULL);
        d->CmdDispatch(r->stream.commands, p->groups, 1, 1);
        CN_TRY(cn_device_stream_finish(&r->stream));
        CN_TRY(bench_clock_end());
        *seconds = fmin(*seconds, bench_clock_sum(VK_NULL_HANDLE));
    }
    return CN_OK;
}

static cn_status make_and_time(rig *r, const program *p, bool quick, double *seconds)
{
    CN_TRY(cn_device_stream_create(r->device, false, &r->stream));
    for (int i = 0; i < 2; i++)
        CN_TRY(cn_device_buffer_create(r->device, p->bytes[i], false, &r->buffer[i]));
    CN_TRY(bind_buffers(r));
    CN_TRY(compile(r, p));
    return time_runs(r, p, quick, seconds);
}

static cn_status run(cn_vulkan *d, const program *p, bool quick, double *seconds)
{
    rig r = { .device = d };
    const cn_status status = make_and_time(&r, p, quick, seconds);
    if (r.pipeline) d->DestroyPipeline(d->handle, r.pipeline, NULL);
    if (r.layout) d->DestroyPipelineLayout(d->handle, r.layout, NULL);
    if (r.set_layout) d->DestroyDescriptorSetLayout(d->handle, r.set_layout, NULL);
    if (r.pool) d->DestroyDescriptorPool(d->handle, r.pool, NULL);
    for (int i = 0; i < 2; i++)
        cn_device_buffer_destroy(d, &r.buffer[i]);
    cn_device_stream_destroy(&r.stream);
    return status;
}

#define CODE(name) cn_spirv_bench_##name, sizeof cn_spirv_bench_##name

cn_status bench_device_measure(cn_vulkan *d, size_t table_bytes, bool quick, bench_device_limits *limits)
{
    const bool slow = d->base.info.software;
    const uint32_t groups = slow ? 1024 : 16384, each = 16, turns = slow ? 256 : 4096, reads = slow ? 64 : 256;
    const size_t threads = (size_t)groups * THREADS, vectors = threads * each * 16;
    double seconds;
    const program stream = { CODE(stream), { each, 0 }, { vectors, vectors }, groups };
    CN_TRY(run(d, &stream, quick, &seconds));
    limits->bytes_per_s = 2 * (double)vectors / seconds;
    const program multiply = { CODE(multiply), { turns, 0 }, { 64, threads * 16 }, groups };
    CN_TRY(run(d, &multiply, quick, &seconds));
    limits->flops_per_s = (double)threads * turns * 64 / seconds;
    const program read = { CODE(random), { reads, 0 }, { table_bytes, threads * 4 }, groups };
    CN_TRY(run(d, &read, quick, &seconds));
    limits->reads_per_s = (double)threads * reads / seconds;
    const program update = { CODE(random), { reads, 1 }, { table_bytes, threads * 4 }, groups };
    CN_TRY(run(d, &update, quick, &seconds));
    limits->updates_per_s = (double)threads * reads / seconds;
    return CN_OK;
}
