#version 460
// Gradients of the weights, for each slot of groups. Four threads do 4 x 4 weights, each over every fourth live sample
// in order: there are too few weights for one thread each to hide what the memory takes.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "step.glsl"
layout(local_size_x = 64, local_size_y = 4) in;
layout(std430, binding = 1) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 2) readonly buffer GroupLive { uint group_live[]; };
layout(std430, binding = 3) readonly buffer Acts { vec4 acts[]; };
layout(std430, binding = 4) readonly buffer DActs { vec4 d_acts[]; };
layout(std430, binding = 5) writeonly buffer SlotGrad { float slot_grad[]; };
shared vec4 sum_of[3][4][64];

// Finds the layer that a tile belongs to; false past the last.
bool find(uint tile, out uint offset, out uint n_in, out uint x_row, out uint dy_row, out uint within)
{
    const uint out_of[5] = { s.density_width, GEO, s.colour_width, s.colour_width, 4 };
    const uint in_of[5] = { s.enc_rows, s.density_width, s.colour_in, s.colour_width, s.colour_width };
    const uint x_of[5] = { 0, row_hidden(), row_in(), row_colour0(), row_colour1() };
    const uint dy_of[5] = { d_row_hidden(), d_row_in(), d_row_colour0(), d_row_colour1(), 0 };
    offset = 0;
    for (uint l = 0; l < 5; l++) {
        const uint tiles = out_of[l] / 4 * (in_of[l] / 4);
        n_in = in_of[l];
        x_row = x_of[l];
        dy_row = dy_of[l];
        within = tile;
        if (tile < tiles) return true;
        tile -= tiles;
        offset += out_of[l] * in_of[l];
    }
    return false;
}

void main()
{
    const uint slot = gl_WorkGroupID.y, quarter = gl_LocalInvocationID.y, thread = gl_LocalInvocationID.x;
    uint offset, n_in, x_row, dy_row, within;
    const bool used = find(gl_GlobalInvocationID.x, offset, n_in, x_row, dy_row, within);
    const uint o = within / (n_in / 4) * 4, i = within % (n_in / 4) * 4;
    const uint x_at = (x_row + i) / 4, dy_at = (dy_row + o) / 4, x_stride = act_rows() / 4, dy_stride = d_act_rows() / 4;
    vec4 sum[4] = { vec4(0), vec4(0), vec4(0), vec4(0) };
    for (uint g = slot; g < s.n_groups && used; g += SLOTS) {
        const uint n = group_live[g], first = group_panel[g].x * PANEL;
        for (uint k = quarter; k < n; k += 4) {
            const vec4 x = acts[(first + k) * x_stride + x_at], dy = d_acts[(first + k) * dy_stride + dy_at];
            [[unroll]] for (uint q = 0; q < 4; q++)
                sum[q] += dy[q] * x;
        }
    }
    [[unroll]] for (uint q = 0; q < 4; q++)
        if (quarter > 0) sum_of[quarter - 1][q][thread] = sum[q];
    barrier();
    if (quarter > 0 || !used) return;
    [[unroll]] for (uint q = 0; q < 4; q++) {
        const vec4 all = sum[q] + sum_of[0][q][thread] + sum_of[1][q][thread] + sum_of[2][q][thread];
        [[unroll]] for (uint k = 0; k < 4; k++)
            slot_grad[slot * s.n_values + offset + (o + q) * n_in + i + k] = all[k];
    }
}
