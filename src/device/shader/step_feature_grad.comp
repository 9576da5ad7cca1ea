#version 460
// Gradients of the transients' table, for each slot of groups and each level. A thread does every 64th entry, over the
// rays in order.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "effects.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 2) readonly buffer GroupSamples { uint group_samples[]; };
layout(std430, binding = 3) readonly buffer RayPhoto { uint ray_photo[]; };
layout(std430, binding = 4) readonly buffer RayUv { vec2 ray_uv[]; };
layout(std430, binding = 5) readonly buffer KeptD { float kept_d[]; };
layout(std430, binding = 6) buffer SlotGrad { float slot_grad[]; };
const uint NODES = 4 * GROUP;
shared uint at_of[NODES];
shared vec2 d_of[NODES];

void main()
{
    const uint thread = gl_LocalInvocationID.x, slot = gl_WorkGroupID.x, which = gl_WorkGroupID.y;
    const uint base = slot * s.n_values + s.at_transient_head;
    for (uint g = slot; g < s.n_groups; g += SLOTS) {
        if (group_panel[g].x == NONE || (group_samples[g] == 0 && s.background == 0)) continue;
        barrier();
        if (thread < GROUP) {
            const uint r = g * GROUP + thread, row = g * ROWS_D + D_FEATURE + FEATURES * which;
            const vec2 d = vec2(kept_d[row * GROUP + thread], kept_d[(row + 1) * GROUP + thread]);
            uint at[4];
            float weight[4];
            nodes_of(ray_uv[r], ray_photo[r], which, at, weight);
            for (uint k = 0; k < 4; k++) {
                at_of[4 * thread + k] = at[k];
                d_of[4 * thread + k] = weight[k] * d;
            }
        }
        barrier();
        for (uint k = 0; k < NODES; k++) {
            if (at_of[k] / FEATURES % 64 != thread) continue;
            slot_grad[base + at_of[k]] += d_of[k].x;
            slot_grad[base + at_of[k] + 1] += d_of[k].y;
        }
    }
}
