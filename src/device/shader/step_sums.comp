#version 460
// For each slot: the sums of the rays' losses, the number of live samples, and the sum of the squares of all gradients,
// in a fixed order. Where the processor does the effects, it has summed the losses.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 256) in;
layout(std430, binding = 1) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 2) readonly buffer GroupLive { uint group_live[]; };
layout(std430, binding = 3) readonly buffer Enc { float enc[]; };
layout(std430, binding = 4) readonly buffer SlotGrad { float slot_grad[]; };
layout(std430, binding = 5) readonly buffer GroupSums { float group_sums[]; };
layout(std430, binding = 6) buffer Sums { float sums[]; };
shared float part[256];

void main()
{
    const uint i = gl_LocalInvocationID.x, slot = gl_WorkGroupID.x, panel_floats = s.enc_rows * PANEL;
    float sum = 0;
    uint n_live = 0;
    for (uint g = slot; g < s.n_groups; g += SLOTS) {
        n_live += group_live[g];
        const uint first = group_panel[g].x * panel_floats, n = panels_of(group_live[g]) * panel_floats;
        for (uint k = i; k < n; k += 256)
            sum += enc[first + k] * enc[first + k];
    }
    for (uint k = i; k < s.n_values; k += 256) {
        const float d = slot_grad[slot * s.n_values + k];
        sum += d * d;
    }
    const bool of_rays = i < 4 || i == 5 || (i >= 8 && i < 15);
    if (of_rays && s.effects_by_processor == 0) {
        float loss = 0;
        for (uint g = slot; g < s.n_groups; g += SLOTS)
            loss += group_sums[g * SUM_KINDS + i];
        sums[slot * SUM_KINDS + i] = loss;
    }
    part[i] = sum;
    for (uint half_ = 128; half_ > 0; half_ /= 2) {
        barrier();
        if (i < half_) part[i] += part[i + half_];
    }
    if (i != 0) return;
    sums[slot * SUM_KINDS + 4] = float(n_live);
    sums[slot * SUM_KINDS + 6] = part[0];
    sums[slot * SUM_KINDS + 7] = 1;
}
