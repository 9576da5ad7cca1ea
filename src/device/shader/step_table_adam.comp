#version 460
// Adam on the entries of the table that have a gradient. A thread does a block of 8 entries, whose state is contiguous:
// low halves, m and v, two features in a word.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Levels { uvec4 level[]; };
layout(std430, binding = 2) buffer Table { uint table[]; };
layout(std430, binding = 3) buffer State { uint state[]; };
layout(std430, binding = 4) buffer Fixed { uint fixed_sum[]; };
layout(std430, binding = 5) buffer Touched { uint touched[]; };

const uint STATE_WORDS = 24, M = 8, V = 16;

float take(uint at)
{
    uint low = fixed_sum[at], high = fixed_sum[at + 1];
    fixed_sum[at] = fixed_sum[at + 1] = 0;
    const bool negative = int(high) < 0;
    if (negative) {
        low = ~low + 1;
        high = ~high + (low == 0 ? 1 : 0);
    }
    const float size = float(high) / 65536 + float(low) / 65536 / 4294967296.0;
    return negative ? -size : size;
}

uint half_of(uint word, uint f)
{
    return word >> 16 * f & 0xffffu;
}
uint with_half(uint word, uint f, uint x)
{
    return f == 0 ? (word & 0xffff0000u) | x : (word & 0xffffu) | x << 16;
}

void main()
{
    const uint block = gl_GlobalInvocationID.x, which = gl_GlobalInvocationID.y;
    const uvec4 l = level[which];
    if (block * TOUCH >= l.y || touched[(l.z >> 3) + which + block] == 0) return;
    touched[(l.z >> 3) + which + block] = 0;
    const uint base = ((l.z >> 3) + which + block) * STATE_WORDS;
    for (uint k = 0; k < TOUCH && block * TOUCH + k < l.y; k++) {
        const uint entry = l.z + block * TOUCH + k;
        for (uint f = 0; f < 2; f++) {
            const float g = take(4 * entry + 2 * f);
            if (g == 0) continue;
            const uint low = half_of(state[base + k], f), high = half_of(table[entry], f);
            float p = uintBitsToFloat(((high - (low >> 15)) << 16) + low);
            float m = uintBitsToFloat(half_of(state[base + M + k], f) << 16);
            float v = uintBitsToFloat(half_of(state[base + V + k], f) << 16);
            m = s.beta1 * m + (1 - s.beta1) * g;
            v = s.beta2 * v + (1 - s.beta2) * g * g;
            p -= s.rate_table * m / (sqrt(v) + s.epsilon);
            const uint bits = floatBitsToUint(p);
            table[entry] = with_half(table[entry], f, bits + 0x8000u >> 16);
            state[base + k] = with_half(state[base + k], f, bits & 0xffffu);
            state[base + M + k] = with_half(state[base + M + k], f, floatBitsToUint(m) + s.dither >> 16);
            state[base + V + k] = with_half(state[base + V + k], f, floatBitsToUint(v) + s.dither >> 16);
        }
    }
}
