#version 460
// Both networks backward for the live samples: gradients of every layer, and of the encoding, which replace the
// encodings. Lanes of a live panel without a sample get gradients of 0.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(std430, binding = 1) readonly buffer Weights { vec4 weights[]; }; // each layer [out][in]
layout(std430, binding = 2) readonly buffer Counts { uint n_panels; };
layout(std430, binding = 3) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 4) readonly buffer GroupLive { uint group_live[]; };
layout(std430, binding = 5) readonly buffer PanelGroup { uint panel_group[]; };
layout(std430, binding = 6) readonly buffer DSample { vec4 d_sample[]; };
layout(std430, binding = 7) readonly buffer Acts { vec4 acts[]; };
layout(std430, binding = 8) readonly buffer LivePos { vec4 live_pos[]; };
layout(std430, binding = 9) writeonly buffer DActs { vec4 d_acts[]; };
layout(std430, binding = 10) writeonly buffer Enc { float enc[]; };
layout(std430, binding = 11) writeonly buffer Pos { float pos[]; };
#include "layers.glsl"
#include "live.glsl"

bool used;

void keep(uint lane, uint half_, uint to, uint rows)
{
    for (uint r = 0; r < rows && used; r += 4)
        d_acts[(lane * d_act_rows() + to + r) / 4] = ACT4(half_, r);
}
// No gradient passes where the activation of the forward pass is 0. 16 rows are read before the first is used, so that
// their reads overlap.
void gate(uint lane, uint half_, uint row, uint rows)
{
    const uint from = (lane * act_rows() + row) / 4;
    for (uint r = 0; r < rows && used; r += 16) {
        vec4 x[4];
        [[unroll]] for (uint k = 0; k < 4; k++)
            x[k] = r + 4 * k < rows ? acts[from + r / 4 + k] : vec4(1);
        [[unroll]] for (uint k = 0; k < 16; k++)
            if (!(x[k / 4][k % 4] > 0)) ACT(half_, r + k) = 0;
    }
}

void main()
{
    const uint lane = gl_GlobalInvocationID.x;
    uint group, place;
    if (gl_WorkGroupID.x * LANES >= n_panels * PANEL) return; // all threads
    used = is_live(lane, group, place);
    const vec4 d = used ? d_sample[lane] : vec4(0);
    for (uint c = 0; c < 4; c++)
        ACT(0, c) = c < 3 ? d[c] : 0;
    keep(lane, 0, 0, 4);
    dense(at_colour2(), s.colour_width, 4, 0, false);
    gate(lane, 1, row_colour1(), s.colour_width);
    keep(lane, 1, d_row_colour1(), s.colour_width);
    dense(at_colour1(), s.colour_width, s.colour_width, 1, false);
    gate(lane, 0, row_colour0(), s.colour_width);
    keep(lane, 0, d_row_colour0(), s.colour_width);
    dense(at_colour0(), s.colour_in, s.colour_width, 0, false);
    ACT(1, 0) += d.w;
    keep(lane, 1, d_row_in(), s.colour_in);
    dense(at_density1(), s.density_width, GEO, 1, false);
    gate(lane, 0, row_hidden(), s.density_width);
    keep(lane, 0, d_row_hidden(), s.density_width);
    dense(0, s.enc_rows, s.density_width, 0, false);
    const bool tail = !used && lane < n_panels * PANEL && place < panels_of(group_live[group]) * PANEL;
    for (uint r = 0; r < s.enc_rows && (used || tail); r++)
        enc[at_lane(lane, r, s.enc_rows)] = used ? ACT(1, r) : 0;
    for (uint a = 0; a < 3 && used; a++)
        pos[at_lane(lane, a, 3)] = live_pos[lane][a];
}
