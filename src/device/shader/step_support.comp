#version 460
// Multi-view support (src/train/support.c): the cell of every sample of a group, and which of its live samples lie in a
// cell that only one photo shows.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer GroupSamples { uint group_samples[]; };
layout(std430, binding = 2) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 3) readonly buffer GroupLive { uint group_live[]; };
layout(std430, binding = 4) readonly buffer Pos { float pos[]; };
layout(std430, binding = 5) readonly buffer LiveFrom { uvec2 live_from[]; };
layout(std430, binding = 6) readonly buffer Since { float since[]; };
layout(std430, binding = 7) readonly buffer Times { float times[]; };
layout(std430, binding = 8) coherent buffer Cell { uint support_cell[]; };
layout(std430, binding = 9) writeonly buffer SingleView { uint single_view[]; };

const uint RES = 4 * OCC_RES;
const float OFTEN = 8;

void main()
{
    const uint i = gl_LocalInvocationID.x, g = gl_WorkGroupID.x;
    if (group_panel[g].x == NONE) return; // all threads of the group
    const uint first = group_panel[g].x * PANEL;
    for (uint lane = first + i; lane < first + group_samples[g]; lane += 64) {
        const vec3 at = vec3(pos[at_lane(lane, 0, 3)], pos[at_lane(lane, 1, 3)], pos[at_lane(lane, 2, 3)]);
        const uvec3 c = uvec3(clamp(at * float(RES), vec3(0), vec3(RES - 1)));
        support_cell[lane] = ((c.x ^ c.y * 2654435761u ^ c.z * 805459861u) * 2246822519u) >> 10;
    }
    memoryBarrierBuffer();
    barrier();
    for (uint k = first + i; k < first + group_live[g]; k += 64) {
        const uint c = support_cell[live_from[k].x];
        single_view[k] = times[c] >= OFTEN && since[c] + s.remembered < float(s.step) ? 1 : 0;
    }
}
