#version 460
// Adds the colours of a round to the rays, in the order of the samples. Then lists the rays that have not ended.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
layout(local_size_x = 64) in;

void main()
{
    const uint i = gl_GlobalInvocationID.x;
    if (i >= going.n_in) return;
    const uint ray = ray_of(i);
    for (uint k = 0; k < states[ray].count; k++) {
        const uint slot = i * ROUND + k;
        if (colour[slot].w > 0) sums[ray * push.parts + part_of(slot)].rgb += colour[slot].xyz;
    }
    if (states[ray].at < states[ray].end && states[ray].transmittance > push.min_transmittance)
        going.list[(1 - push.parity) * push.max_rays + atomicAdd(going.n_out, 1)] = ray;
}
