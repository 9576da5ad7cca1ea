// What all passes share: buffers, sizes, and the states of a ray. src/device/tracer.h has the same structs in C.
#extension GL_GOOGLE_include_directive : require

const uint ROUND = 8; // the most samples of a ray in one round
const uint GEO = 16;  // geometry features; the first is the density logit

struct Ray {
    vec3 origin;
    float end;
    vec3 dir;
    float unused;
};
struct State {
    vec3 rgb;
    float transmittance;
    float at, depth, surface, weight;
    float carried;
    uint count;
    uint unused[2];
};

layout(push_constant) uniform Push {
    uint max_rays, levels, enc_rows, density_width, colour_width, columns, parity, phase;
    float ratio, step, inv_extent, min_transmittance, depth_left, min_weight;
    uint lanes, softplus;
} push;

// Slot i * ROUND + k is sample k of the i-th ray that has not ended.
layout(std430, binding = 0) readonly buffer Table { uint table[]; };
layout(std430, binding = 1) readonly buffer Weights { vec4 weights[]; }; // each layer [in][out]
layout(std430, binding = 2) readonly buffer Occupancy { uint occupancy[]; };
layout(std430, binding = 3) readonly buffer Levels { uvec4 level[]; }; // resolution, entries, offset, hashed
layout(std430, binding = 4) readonly buffer Rays { Ray rays[]; };
layout(std430, binding = 5) readonly buffer Columns { float columns[]; }; // [ray][columns]
layout(std430, binding = 6) buffer States { State states[]; };
layout(std430, binding = 7) buffer Going {
    uint n_in, n_out, n_visible, n_samples;
    uvec4 groups_ray, groups_level, groups_sample, groups_visible;
    uint list[]; // two lists of max_rays; the parity of the round says which one is read
} going;
layout(std430, binding = 8) buffer Distances { float t_at[]; };      // [slot]
layout(std430, binding = 9) buffer Places { vec4 place[]; };         // [slot]: contracted position, length of the step
layout(std430, binding = 10) buffer Encodings { float encoding[]; }; // [row][slot]
layout(std430, binding = 11) buffer Features { float feature[]; };   // [GEO][slot]
layout(std430, binding = 12) buffer Visible { uint visible[]; };     // slots that need a colour
layout(std430, binding = 13) buffer Colours { vec4 colour[]; };      // [slot]: colour times weight, weight

uint slots()
{
    return push.max_rays * ROUND;
}
uint ray_of(uint i)
{
    return going.list[push.parity * push.max_rays + i];
}
