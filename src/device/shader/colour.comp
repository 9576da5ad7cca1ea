#version 460
// The colour network, for the samples with enough weight. Input: geometry features, and the columns of the ray's
// conditioning. Two hidden layers. Output: linear light.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "light.glsl"
#include "network.glsl"

void main()
{
    if (gl_GlobalInvocationID.x >= going.n_visible) return;
    const uint slot = visible[gl_GlobalInvocationID.x], ray = ray_of(slot / ROUND);
    if (part_of(slot) != push.part) return;
    const uint width = parts[push.part].colour_width, n_columns = parts[push.part].columns, rows = GEO + n_columns;
    const uint first_column = ray * push.columns + parts[push.part].column_at;
    for (uint r = 0; r < GEO; r++)
        act[at(0, r)] = feature[r * slots() + slot];
    for (uint c = 0; c < n_columns; c++)
        act[at(0, GEO + c)] = columns[first_column + c];
    uint offset = parts[push.part].density_width * (parts[push.part].enc_rows + GEO);
    dense(offset, width, rows, 0, true);
    offset += width * rows;
    dense(offset, width, width, 1, true);
    offset += width * width;
    dense(offset, 4, width, 0, false);
    const float w = colour[slot].w;
    colour[slot].xyz = w * vec3(light(act[at(1, 0)]), light(act[at(1, 1)]), light(act[at(1, 2)]));
}
