// What all passes share: buffers, sizes, and the states of a ray. src/device/trace.h has the same structs in C.
#extension GL_GOOGLE_include_directive : require

layout(constant_id = 2) const uint ROUND = 8; // the most samples of a ray in one round, and no fewer than parts
const uint GEO = 16;                          // geometry features; the first is the density logit
const uint PARTS = 16, LEVELS = 24;           // fields of a march, and levels of a grid, at most

// A ray in the box of one part.
struct Ray {
    vec3 origin;
    float end;
    vec3 dir;
    float begin;
};
struct State {
    float transmittance, at, depth, surface;
    float end;
    float dir_x, dir_y, dir_z;
    uint count;
    uint unused[3];
};
// What a ray shows of one part.
struct Sum {
    vec3 rgb;
    float weight;
    float carried;
    uint unused[3];
};
struct Part {
    vec2 centre;
    float blend_width, offset;
    float inv_extent;
    uint softplus, levels, enc_rows;
    uint density_width, colour_width, columns, column_at;
    uvec4 level[LEVELS]; // resolution, entries, offset, hashed
    uint has_sky, unused_a, unused_b, unused_c;
    float sky_code[12], sky[32 * (16 + 32 + 4)];
};

layout(push_constant) uniform Push {
    uint max_rays, parts, part, levels, columns, parity, phase, lanes, n_rays;
    float ratio, step, min_transmittance, depth_left, min_weight;
    uint fine_depth;
} push;

// Slot i * ROUND + k is sample k of the i-th ray that has not ended. Table and weights are those of push.part.
layout(std430, binding = 0) readonly buffer Table { uint table[]; };
layout(std430, binding = 1) readonly buffer Weights { vec4 weights[]; }; // each layer [in][out]
layout(std430, binding = 2) readonly buffer Occupancy { uint occupancy[]; }; // [part][cell]
layout(std430, binding = 3) readonly buffer Parts { Part parts[]; };
layout(std430, binding = 4) readonly buffer Rays { Ray rays[]; };            // [ray][part]
layout(std430, binding = 5) readonly buffer Columns { float columns[]; };    // [ray][columns of all parts]
layout(std430, binding = 6) buffer States { State states[]; };               // [ray]
layout(std430, binding = 7) buffer Sums { Sum sums[]; };                     // [ray][part]
layout(std430, binding = 8) buffer Going {
    uint n_in, n_out, n_visible, n_samples;
    uvec4 groups_ray, groups_visible;
    uint present, unused[3]; // bits of the parts with samples in this round
    uvec4 groups_level[PARTS], groups_sample[PARTS];
    uint list[]; // two lists of max_rays; the parity of the round says which one is read
} going;
layout(std430, binding = 9) buffer Samples { uvec2 samples[]; };      // [slot]: the bits of t, and the part
layout(std430, binding = 10) buffer Places { vec4 place[]; };         // [slot]: contracted position; length times share
layout(std430, binding = 11) buffer Encodings { float encoding[]; };  // [row][slot]
layout(std430, binding = 12) buffer Features { float feature[]; };    // [GEO][slot]
layout(std430, binding = 13) buffer Visible { uint visible[]; };      // slots that need a colour
layout(std430, binding = 14) buffer Colours { vec4 colour[]; };       // [slot]: colour times weight, weight

uint slots()
{
    return push.max_rays * ROUND;
}
uint ray_of(uint i)
{
    return going.list[push.parity * push.max_rays + i];
}
float t_of(uint slot)
{
    return uintBitsToFloat(samples[slot].x);
}
uint part_of(uint slot)
{
    return samples[slot].y;
}
// Whether a sample of push.part is there. In phase 1 slots have places without rays.
bool is_mine(uint slot)
{
    if (push.phase == 1) return slot < going.n_in;
    const uint i = slot / ROUND;
    return i < going.n_in && slot % ROUND < states[ray_of(i)].count && part_of(slot) == push.part;
}
