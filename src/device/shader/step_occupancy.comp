#version 460
// Updates the cells that the step visited. Of the visits of a cell, one thread takes the cell's value and clears it.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer GroupSamples { uint group_samples[]; };
layout(std430, binding = 2) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 3) readonly buffer VisitCell { uint visit_cell[]; };
layout(std430, binding = 4) buffer CellMost { uint cell_most[]; };
layout(std430, binding = 5) buffer Seen { float seen[]; };
layout(std430, binding = 6) buffer Visited { uint visited[]; };
layout(std430, binding = 7) buffer Bits { uint bits[]; };

const float FULL = 0.015, UNPROVEN = 2;

void update(uint cell, float most)
{
    const float held = seen[cell];
    if (held < 0) return;
    const bool unproven = held > 1;
    const float kept = visited[cell] == s.step + 1 ? 1 : s.cell_decay;
    const float value = max((unproven ? held - UNPROVEN : held) * kept, most);
    visited[cell] = s.step + 1;
    seen[cell] = unproven && most < FULL && value >= FULL ? UNPROVEN + value : value;
    if (value >= FULL)
        atomicOr(bits[cell >> 5], 1u << (cell & 31));
    else
        atomicAnd(bits[cell >> 5], ~(1u << (cell & 31)));
}

void main()
{
    const uint g = gl_WorkGroupID.x;
    if (group_panel[g].x == NONE) return;
    for (uint k = gl_LocalInvocationID.x; k < group_samples[g]; k += 64) {
        const uint cell = visit_cell[group_panel[g].x * PANEL + k], most = atomicExchange(cell_most[cell], 0);
        if (most != 0) update(cell, uintBitsToFloat(most - 1));
    }
}
