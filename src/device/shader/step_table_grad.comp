#version 460
// Gradients of the table's entries from those of the encodings. A group of threads does a group of rays and a level. Sums are integers in fixed point, so their order does
// not matter. 64 bits are two words with a carry: an atomic sum of 64 bits is not in every driver.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "grid.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Levels { uvec4 level[]; };
layout(std430, binding = 2) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 3) readonly buffer GroupLive { uint group_live[]; };
layout(std430, binding = 4) readonly buffer Pos { float pos[]; };
layout(std430, binding = 5) readonly buffer Enc { float enc[]; };
layout(std430, binding = 6) buffer Fixed { uint fixed_sum[]; }; // [entry][feature][low, high]
layout(std430, binding = 7) buffer Touched { uint touched[]; };

// The sums have 48 bits behind the point. Larger gradients than this are bounded; the monitor refuses such steps.
const float MOST = 8192;

void add(uint to, float x)
{
    const float size = min(abs(x), MOST) * 65536, whole = floor(size);
    uint high = uint(whole), low = uint((size - whole) * 4294967296.0);
    if (x < 0) {
        low = ~low + 1;
        high = ~high + (low == 0 ? 1 : 0);
    }
    const uint before = atomicAdd(fixed_sum[to], low), carry = before + low < before ? 1 : 0;
    if (high + carry != 0) atomicAdd(fixed_sum[to + 1], high + carry);
}

void spread(uint lane, uint which)
{
    const float g0 = enc[at_lane(lane, 2 * which, s.enc_rows)], g1 = enc[at_lane(lane, 2 * which + 1, s.enc_rows)];
    if (g0 == 0 && g1 == 0) return;
    const uvec4 l = level[which];
    uvec3 corner;
    vec3 f;
    cell_at(l, vec3(pos[at_lane(lane, 0, 3)], pos[at_lane(lane, 1, 3)], pos[at_lane(lane, 2, 3)]), corner, f);
    for (uint c = 0; c < 8; c++) {
        const vec3 k = corner_weights(c, f);
        const float w = k.x * k.y * k.z;
        const uint entry = entry_of(l, corner + uvec3(c & 1, c >> 1 & 1, c >> 2));
        const uint block = (l.z >> 3) + which + entry / TOUCH;
        if (touched[block] == 0) atomicOr(touched[block], 1);
        add(4 * (l.z + entry), w * g0);
        add(4 * (l.z + entry) + 2, w * g1);
    }
}

void main()
{
    const uint g = gl_WorkGroupID.x, n = group_live[g];
    for (uint k = gl_LocalInvocationID.x; k < n; k += 64)
        spread(group_panel[g].x * PANEL + k, gl_WorkGroupID.y);
}
