#version 460
// Features of every sample from one level of the grid.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "grid.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Levels { uvec4 level[]; };
layout(std430, binding = 2) readonly buffer Table { uint table[]; };
layout(std430, binding = 3) readonly buffer Counts { uint n_panels; };
layout(std430, binding = 4) readonly buffer Pos { float pos[]; };
layout(std430, binding = 5) writeonly buffer Enc { float enc[]; };

void main()
{
    const uint lane = gl_GlobalInvocationID.x, which = gl_GlobalInvocationID.y;
    if (lane >= n_panels * PANEL) return;
    const uvec4 l = level[which];
    uvec3 corner;
    vec3 f;
    cell_at(l, vec3(pos[at_lane(lane, 0, 3)], pos[at_lane(lane, 1, 3)], pos[at_lane(lane, 2, 3)]), corner, f);
    vec2 sum = vec2(0);
    for (uint c = 0; c < 8; c++) {
        const vec3 w = corner_weights(c, f);
        const uint pair = table[l.z + entry_of(l, corner + uvec3(c & 1, c >> 1 & 1, c >> 2))];
        sum += w.x * w.y * w.z * vec2(uintBitsToFloat(pair << 16), uintBitsToFloat(pair & 0xffff0000u));
    }
    enc[at_lane(lane, 2 * which, s.enc_rows)] = sum.x;
    enc[at_lane(lane, 2 * which + 1, s.enc_rows)] = sum.y;
    // Padding rows behind the last level.
    if (which + 1 == s.levels)
        for (uint r = 2 * s.levels; r < s.enc_rows; r++)
            enc[at_lane(lane, r, s.enc_rows)] = 0;
}
