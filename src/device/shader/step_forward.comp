#version 460
// Both networks for the live samples, with the activations that the backward pass needs.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(std430, binding = 1) readonly buffer Weights { vec4 weights[]; };
layout(std430, binding = 2) readonly buffer Counts { uint n_panels; };
layout(std430, binding = 3) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 4) readonly buffer GroupLive { uint group_live[]; };
layout(std430, binding = 5) readonly buffer PanelGroup { uint panel_group[]; };
layout(std430, binding = 6) readonly buffer LiveFrom { uvec2 live_from[]; };
layout(std430, binding = 7) readonly buffer Enc { float enc[]; };
layout(std430, binding = 8) readonly buffer Pos { float pos[]; };
layout(std430, binding = 9) readonly buffer Conditioning { float conditioning[]; };
layout(std430, binding = 10) writeonly buffer LivePos { vec4 live_pos[]; };
layout(std430, binding = 11) writeonly buffer Acts { float acts[]; };
layout(std430, binding = 12) writeonly buffer Colour { vec4 colour[]; };
#include "network.glsl"
#include "live.glsl"

void keep(uint lane, uint half_, uint from, uint to, uint rows)
{
    for (uint r = 0; r < rows; r++)
        acts[lane * act_rows() + to + r] = act[at(half_, from + r)];
}

void main()
{
    const uint lane = gl_GlobalInvocationID.x;
    uint group, place;
    if (!is_live(lane, group, place)) return;
    const uvec2 from = live_from[lane];
    live_pos[lane] =
        vec4(pos[at_lane(from.x, 0, 3)], pos[at_lane(from.x, 1, 3)], pos[at_lane(from.x, 2, 3)], 0);
    for (uint r = 0; r < s.enc_rows; r++)
        act[at(0, r)] = enc[at_lane(from.x, r, s.enc_rows)];
    keep(lane, 0, 0, 0, s.enc_rows);
    dense(0, s.density_width, s.enc_rows, 0, true);
    keep(lane, 1, 0, row_hidden(), s.density_width);
    dense(at_density1(), GEO, s.density_width, 1, false);
    for (uint c = 0; c < columns(); c++)
        act[at(0, GEO + c)] = conditioning[from.y * columns() + c];
    keep(lane, 0, 0, row_in(), s.colour_in);
    dense(at_colour0(), s.colour_width, s.colour_in, 0, true);
    keep(lane, 1, 0, row_colour0(), s.colour_width);
    dense(at_colour1(), s.colour_width, s.colour_width, 1, true);
    keep(lane, 0, 0, row_colour1(), s.colour_width);
    dense(at_colour2(), 4, s.colour_width, 0, false);
    colour[lane] = vec4(light(act[at(1, 0)]), light(act[at(1, 1)]), light(act[at(1, 2)]), 0);
}
