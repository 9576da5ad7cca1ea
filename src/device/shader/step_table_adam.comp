#version 460
// Adam on the entries of the table that have a gradient. A thread takes one entry after the other, as many threads
// apart as there are: a level may have more entries than a device starts threads. The state of a block of 8 entries is
// contiguous: low halves, m and v, two features in a word; so threads side by side read words side by side.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "step.glsl"
layout(local_size_x = 256) in;
layout(std430, binding = 1) readonly buffer Levels { uvec4 level[]; };
layout(std430, binding = 2) buffer Table { uint table[]; };
layout(std430, binding = 3) buffer State { uint state[]; };
layout(std430, binding = 4) buffer Fixed { uvec4 fixed_sum[]; }; // low and high word of each feature
layout(std430, binding = 5) readonly buffer Touched { uint touched[]; };

const uint STATE_WORDS = 24, M = 8, V = 16;

float value_of(uvec2 sum)
{
    const bool negative = int(sum.y) < 0;
    if (negative) {
        sum.x = ~sum.x + 1;
        sum.y = ~sum.y + (sum.x == 0 ? 1 : 0);
    }
    const float size = float(sum.y) / 65536 + float(sum.x) / 65536 / 4294967296.0;
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

void optimise(uint at, uint which, uvec4 l)
{
    const uint block = (l.z >> 3) + which + at / TOUCH;
    if (touched[block] == 0) return;
    const uint entry = l.z + at, word = block * STATE_WORDS + at % TOUCH;
    const uvec4 sums = fixed_sum[entry];
    if (sums == uvec4(0)) return;
    fixed_sum[entry] = uvec4(0);
    uint high_halves = table[entry], low_halves = state[word], m_halves = state[word + M], v_halves = state[word + V];
    [[unroll]] for (uint f = 0; f < 2; f++) {
        const float g = value_of(f == 0 ? sums.xy : sums.zw);
        if (g == 0) continue;
        const uint low = half_of(low_halves, f), high = half_of(high_halves, f);
        float p = uintBitsToFloat(((high - (low >> 15)) << 16) + low);
        float m = uintBitsToFloat(half_of(m_halves, f) << 16);
        float v = uintBitsToFloat(half_of(v_halves, f) << 16);
        m = s.beta1 * m + (1 - s.beta1) * g;
        v = s.beta2 * v + (1 - s.beta2) * g * g;
        p -= s.rate_table * m / (sqrt(v) + s.epsilon);
        const uint bits = floatBitsToUint(p);
        high_halves = with_half(high_halves, f, bits + 0x8000u >> 16);
        low_halves = with_half(low_halves, f, bits & 0xffffu);
        m_halves = with_half(m_halves, f, floatBitsToUint(m) + s.dither >> 16);
        v_halves = with_half(v_halves, f, floatBitsToUint(v) + s.dither >> 16);
    }
    table[entry] = high_halves;
    state[word] = low_halves;
    state[word + M] = m_halves;
    state[word + V] = v_halves;
}

void main()
{
    const uint which = gl_GlobalInvocationID.y;
    const uvec4 l = level[which];
    for (uint at = gl_GlobalInvocationID.x; at < l.y; at += gl_NumWorkGroups.x * gl_WorkGroupSize.x)
        optimise(at, which, l);
}
