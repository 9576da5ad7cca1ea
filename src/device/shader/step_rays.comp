#version 460
// Gradients of each ray's origin and direction: the sums over its live samples.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Spans { vec4 span[]; };
layout(std430, binding = 2) readonly buffer DPlace { vec4 d_place[]; };
layout(std430, binding = 3) writeonly buffer DRays { vec4 d_ray[]; };

void main()
{
    const uint r = gl_GlobalInvocationID.x;
    if (r >= s.n_rays) return;
    const uint first = floatBitsToUint(span[r].x), n = floatBitsToUint(span[r].y);
    const vec3 from_mean = vec3(s.from_mean[0], s.from_mean[1], s.from_mean[2]);
    const vec3 from_m = vec3(s.from_m[0], s.from_m[1], s.from_m[2]);
    vec3 origin = vec3(0), dir = vec3(0);
    for (uint i = first; i < first + n; i++) {
        origin += d_place[i].xyz * from_mean;
        dir += d_place[i].xyz * d_place[i].w * from_m;
    }
    d_ray[2 * r] = vec4(origin, 0);
    d_ray[2 * r + 1] = vec4(dir, 0);
}
