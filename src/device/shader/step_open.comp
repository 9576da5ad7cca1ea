#version 460
// Occupancy reactivation (src/train/reactivation.h): along rays that met nothing, empty cells in a gap are opened. One
// ray after the other, in the order of the rays; the threads share the steps along a ray.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 256) in;
layout(std430, binding = 1) readonly buffer Missing { uint missing[]; };
layout(std430, binding = 2) readonly buffer Rays { float ray[]; };
layout(std430, binding = 3) readonly buffer OpenT { float open_t[]; };
layout(std430, binding = 4) coherent buffer Seen { float seen[]; };
layout(std430, binding = 5) coherent buffer Bits { uint bits[]; };
shared uint count[256], list[64];

const uint MAX_RAYS = 64, AT_ONCE = 8;
const float OPENED = 0.5;

bool is_full(uint cell)
{
    return (bits[cell >> 5] >> (cell & 31) & 1) != 0;
}
bool in_a_gap(uint cell, uvec3 c)
{
    const uint stride[3] = { 1, OCC_RES, OCC_RES * OCC_RES };
    uint full = 0;
    for (uint a = 0; a < 3; a++) {
        full += c[a] > 0 && is_full(cell - stride[a]) ? 1 : 0;
        full += c[a] < OCC_RES - 1 && is_full(cell + stride[a]) ? 1 : 0;
    }
    return full > 1;
}

// The cell at a step along a ray, where it has to be opened; else NONE.
uint cell_to_open(uint r, uint k)
{
    if (k >= s.open_steps) return NONE;
    precise const vec3 x = RAY_ORIGIN(r) + open_t[k] * RAY_DIR(r);
    precise const vec3 scaled = (x * contraction(x) + 2) * (OCC_RES / 4.0);
    const uvec3 c = uvec3(clamp(scaled, vec3(0), vec3(OCC_RES - 1)));
    const uint cell = c.x + OCC_RES * (c.y + OCC_RES * c.z);
    return seen[cell] >= 0 && !is_full(cell) && in_a_gap(cell, c) ? cell : NONE;
}

// The first rays that met nothing.
uint find_rays(uint i)
{
    const uint rays = (s.n_rays + 255) / 256, first = i * rays;
    uint n = 0, before = 0;
    for (uint r = first; r < min(first + rays, s.n_rays); r++)
        n += missing[r >> 2] >> 8 * (r & 3) & 255;
    count[i] = n;
    barrier();
    for (uint k = 0; k < i; k++)
        before += count[k];
    for (uint r = first; r < min(first + rays, s.n_rays) && before < MAX_RAYS; r++)
        if ((missing[r >> 2] >> 8 * (r & 3) & 255) != 0) list[before++] = r;
    uint all = 0;
    for (uint k = 0; k < 256; k++)
        all += count[k];
    barrier();
    return min(all, MAX_RAYS);
}

void main()
{
    const uint i = gl_LocalInvocationID.x, n = find_rays(i);
    for (uint q = 0; q < n; q++) {
        uint found[AT_ONCE];
        for (uint k = 0; k < AT_ONCE; k++)
            found[k] = cell_to_open(list[q], k * 256 + i);
        memoryBarrierBuffer();
        barrier();
        for (uint k = 0; k < AT_ONCE; k++) {
            if (found[k] == NONE) continue;
            seen[found[k]] = OPENED;
            atomicOr(bits[found[k] >> 5], 1u << (found[k] & 31));
        }
        memoryBarrierBuffer();
        barrier();
    }
}
