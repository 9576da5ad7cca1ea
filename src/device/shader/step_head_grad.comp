#version 460
// Gradients of the weights of the effects' networks, for each slot of groups. A thread does a weight, over the rays in
// order.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "effects.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 2) readonly buffer GroupSamples { uint group_samples[]; };
layout(std430, binding = 3) readonly buffer KeptX { vec4 kept_x[]; };
layout(std430, binding = 4) readonly buffer KeptD { vec4 kept_d[]; };
layout(std430, binding = 5) writeonly buffer SlotGrad { float slot_grad[]; };

void main()
{
    const uint slot = gl_GlobalInvocationID.y, QUADS = GROUP / 4;
    uint k = gl_GlobalInvocationID.x, l, offset, rows, columns;
    Head h;
    if (!find_weight(k, h, l, offset, rows, columns)) return;
    const uint x_row = l == 0 ? h.x + k % columns : h.x + h.n_in + (l - 1) * h.width + k % columns;
    const uint d_row = h.d + l * h.width + k / columns;
    float sum = 0;
    for (uint g = slot; g < s.n_groups; g += SLOTS) {
        if (group_panel[g].x == NONE || (group_samples[g] == 0 && s.background == 0)) continue;
        for (uint q = 0; q < QUADS; q++)
            sum += dot(kept_x[(g * ROWS_X + x_row) * QUADS + q], kept_d[(g * ROWS_D + d_row) * QUADS + q]);
    }
    slot_grad[slot * s.n_values + h.at + offset + k] = sum;
}
