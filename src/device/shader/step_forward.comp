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
layout(std430, binding = 11) writeonly buffer Acts { vec4 acts[]; };
layout(std430, binding = 12) writeonly buffer Colour { vec4 colour[]; };
#include "layers.glsl"
#include "encoding.glsl"
#include "live.glsl"

bool used;

void keep(uint lane, uint half_, uint to, uint rows)
{
    for (uint r = 0; r < rows && used; r += 4)
        acts[(lane * act_rows() + to + r) / 4] = ACT4(half_, r);
}

void main()
{
    const uint lane = gl_GlobalInvocationID.x;
    uint group, place;
    if (gl_WorkGroupID.x * LANES >= n_panels * PANEL) return; // all threads
    used = is_live(lane, group, place);
    uvec2 from = uvec2(0);
    if (used) {
        from = live_from[lane];
        live_pos[lane] =
            vec4(pos[at_lane(from.x, 0, 3)], pos[at_lane(from.x, 1, 3)], pos[at_lane(from.x, 2, 3)], 0);
    }
    take_encoding(from.x, used, s.enc_rows);
    keep(lane, 0, 0, s.enc_rows);
    dense(0, s.density_width, s.enc_rows, 0, true);
    keep(lane, 1, row_hidden(), s.density_width);
    dense(at_density1(), GEO, s.density_width, 1, false);
    for (uint c = 0; c < columns(); c++)
        ACT(0, GEO + c) = used ? conditioning[from.y * columns() + c] : 0;
    keep(lane, 0, row_in(), s.colour_in);
    dense(at_colour0(), s.colour_width, s.colour_in, 0, true);
    keep(lane, 1, row_colour0(), s.colour_width);
    dense(at_colour1(), s.colour_width, s.colour_width, 1, true);
    keep(lane, 0, row_colour1(), s.colour_width);
    dense(at_colour2(), 4, s.colour_width, 0, false);
    if (used) colour[lane] = vec4(light(ACT(1, 0)), light(ACT(1, 1)), light(ACT(1, 2)), 0);
}
