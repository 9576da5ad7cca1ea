#version 460
// Encodes one level of the hash grid. A thread does one sample. A vertex has two bfloat16 features in one word.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
layout(local_size_x = 64) in;

uint entry(uvec4 l, uvec3 v)
{
    if (l.w == 0) return v.x + (l.x + 2) * (v.y + (l.x + 2) * v.z);
    const uint x = (v.x >> 2) << 4 | (v.x & 1) | (v.x & 2) << 2;
    const uint y = ((v.y >> 1) * 2654435761u) << 4 | (v.y & 1) << 1;
    const uint z = ((v.z >> 1) * 805459861u) << 4 | (v.z & 1) << 2;
    return (x ^ y ^ z) & (l.y - 1);
}

void main()
{
    const uint slot = gl_GlobalInvocationID.x, which = gl_GlobalInvocationID.y;
    if (!is_mine(slot)) return;
    const uvec4 l = parts[push.part].level[which];
    precise const vec3 x = clamp(place[slot].xyz, vec3(0), vec3(1)) * float(l.x) + 0.5;
    const vec3 cell = floor(x), f = x - cell;
    vec2 sum = vec2(0);
    for (uint c = 0; c < 8; c++) {
        const uvec3 corner = uvec3(c & 1, c >> 1 & 1, c >> 2);
        const vec3 w = mix(1 - f, f, equal(corner, uvec3(1)));
        const uint pair = table[l.z + entry(l, uvec3(cell) + corner)];
        sum += w.x * w.y * w.z * vec2(uintBitsToFloat(pair << 16), uintBitsToFloat(pair & 0xffff0000u));
    }
    encoding[2 * which * slots() + slot] = sum.x;
    encoding[(2 * which + 1) * slots() + slot] = sum.y;
}
