#version 460
// Contracted positions and lengths of a group's samples, ray after ray. A thread does one ray.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 32) in;
layout(std430, binding = 1) readonly buffer Rays { float ray[]; };
layout(std430, binding = 2) readonly buffer MarchT { float march_t[]; };
layout(std430, binding = 3) readonly buffer RaySamples { uint ray_samples[]; };
layout(std430, binding = 4) readonly buffer GroupSamples { uint group_samples[]; };
layout(std430, binding = 5) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 6) writeonly buffer Pos { float pos[]; };
layout(std430, binding = 7) writeonly buffer Length { float length_of[]; };

void main()
{
    const uint i = gl_LocalInvocationID.x, g = gl_WorkGroupID.x, r = g * GROUP + i, panel = group_panel[g].x;
    const uint total = group_samples[g];
    if (panel == NONE || total == 0) return;
    // The lanes of the last panel that have no sample.
    for (uint k = total + i; k < panels_of(total) * PANEL; k += GROUP)
        for (uint a = 0; a < 3; a++)
            pos[at_lane(panel * PANEL + k, a, 3)] = 0;
    uint first = 0;
    for (uint k = g * GROUP; k < r; k++)
        first += ray_samples[k];
    const vec3 origin = RAY_ORIGIN(r), dir = RAY_DIR(r);
    for (uint k = first; k < first + ray_samples[r]; k++) {
        const float t = march_t[g * GROUP_CAP + k];
        precise const vec3 x = origin + t * dir;
        const float c = contraction(x);
        precise const vec3 u = x * c * 0.25 + 0.5;
        const uint lane = panel * PANEL + k;
        for (uint a = 0; a < 3; a++)
            pos[at_lane(lane, a, 3)] = u[a];
        precise const float n = s.march_step * t * s.inv_extent * c;
        length_of[lane] = n;
    }
}
