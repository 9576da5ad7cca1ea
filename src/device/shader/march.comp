#version 460
// Marches each ray through the occupancy grid, until a round is full or the ray ends. Writes the contracted positions
// of the samples.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
layout(local_size_x = 64) in;

const uint RES = 128;

void main()
{
    const uint i = gl_GlobalInvocationID.x;
    if (i >= going.n_in) return;
    const uint ray = ray_of(i);
    const Ray r = rays[ray];
    float at = states[ray].at;
    uint n = 0;
    for (; at < r.end && n < ROUND; at *= push.ratio) {
        precise const vec3 x = r.origin + at * r.dir;
        const float m = max(abs(x.x), max(abs(x.y), abs(x.z)));
        precise const float s = m > 1 ? (2 - 1 / m) / m : 1;
        precise const vec3 u = x * s * 0.25 + 0.5;
        const uvec3 cell = uvec3(clamp(u * float(RES), vec3(0), vec3(RES - 1)));
        const uint bit = cell.x + RES * (cell.y + RES * cell.z);
        if ((occupancy[bit >> 5] >> (bit & 31) & 1) == 0) continue;
        t_at[i * ROUND + n] = at;
        place[i * ROUND + n] = vec4(u, push.step * at * push.inv_extent * s);
        n++;
    }
    states[ray].at = at;
    states[ray].count = n;
    atomicAdd(going.n_samples, n);
}
