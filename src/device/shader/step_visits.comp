#version 460
// The most that a step saw of each cell of the occupancy grid. A value is stored as its bits plus 1; 0: no visit.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer GroupSamples { uint group_samples[]; };
layout(std430, binding = 2) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 3) readonly buffer VisitCell { uint visit_cell[]; };
layout(std430, binding = 4) readonly buffer VisitSeen { float visit_seen[]; };
layout(std430, binding = 5) buffer CellMost { uint cell_most[]; };

void main()
{
    const uint g = gl_WorkGroupID.x;
    if (group_panel[g].x == NONE) return;
    for (uint k = gl_LocalInvocationID.x; k < group_samples[g]; k += 64) {
        const uint lane = group_panel[g].x * PANEL + k;
        if (visit_seen[lane] >= 0) atomicMax(cell_most[visit_cell[lane]], floatBitsToUint(visit_seen[lane]) + 1);
    }
}
