#version 460
// Marches the rays of a group through the occupancy grid: first counts their samples, then writes them one ray after
// the other. A ray that does not fit into the group takes no part in the step.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 32) in;
layout(std430, binding = 1) readonly buffer Rays { float ray[]; };
layout(std430, binding = 2) readonly buffer FirstT { float first_t[]; };
layout(std430, binding = 3) readonly buffer Bits { uint bits[]; };
layout(std430, binding = 4) buffer Target { vec4 target[]; };
layout(std430, binding = 5) readonly buffer SkyHint { uint sky_hint[]; };
layout(std430, binding = 6) writeonly buffer MarchT { float march_t[]; };
layout(std430, binding = 7) writeonly buffer RaySamples { uint ray_samples[]; };
layout(std430, binding = 8) writeonly buffer GroupSamples { uint group_samples[]; };
layout(std430, binding = 9) writeonly buffer Missing { uint missing[]; };
shared uint wanted[GROUP], first[GROUP], nothing[GROUP];

bool occupied(vec3 origin, vec3 dir, float t)
{
    precise const vec3 x = origin + t * dir;
    precise const vec3 u = x * contraction(x) * 0.25 + 0.5;
    const uint cell = cell_of(u);
    return (bits[cell >> 5] >> (cell & 31) & 1) != 0;
}

void main()
{
    const uint i = gl_LocalInvocationID.x, g = gl_WorkGroupID.x, r = g * GROUP + i;
    const vec3 origin = RAY_ORIGIN(r), dir = RAY_DIR(r);
    const bool counts = target[r].w > 0;
    uint n = 0;
    if (counts)
        for (float t = first_t[r]; t < s.far_t && n < GROUP_CAP; t *= s.ratio)
            n += occupied(origin, dir, t) ? 1 : 0;
    wanted[i] = n;
    barrier();
    if (i == 0) {
        uint used = 0;
        for (uint k = 0; k < GROUP; k++) {
            if (wanted[k] >= GROUP_CAP - used) wanted[k] = NONE;
            first[k] = used;
            used += wanted[k] == NONE ? 0 : wanted[k];
        }
        group_samples[g] = used;
    }
    barrier();
    const bool dropped = wanted[i] == NONE;
    const uint most = dropped ? 0 : wanted[i], to = g * GROUP_CAP + first[i];
    n = 0;
    if (counts && most > 0)
        for (float t = first_t[r]; t < s.far_t && n < most; t *= s.ratio)
            if (occupied(origin, dir, t)) march_t[to + n++] = t;
    ray_samples[r] = most;
    const bool ends = counts && !dropped && most == 0;
    const bool shows_none = s.has_hints != 0 && (sky_hint[r >> 2] >> 8 * (r & 3) & 255) == 1;
    const bool may_be_sky = s.background != 0 && !shows_none && RAY_Z(r) > 0;
    nothing[i] = ends && !may_be_sky ? 1 : 0;
    if (counts && (dropped || (ends && s.background == 0))) target[r].w = 0;
    barrier();
    if (i % 4 == 0)
        missing[r >> 2] = nothing[i] | nothing[i + 1] << 8 | nothing[i + 2] << 16 | nothing[i + 3] << 24;
}
