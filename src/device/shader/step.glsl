// What the passes of a training step share: sizes, settings, and where a value of a panel lies. src/device/step.h has
// the same structs in C. Every pass has the settings at binding 0, and then its arrays in the order of its list in
// src/device/step_passes.c.
#extension GL_GOOGLE_include_directive : require
#include "light.glsl"

const uint PANEL = 48, GROUP = 32, GROUP_CAP = 4032, SLOTS = 32, GEO = 16, NONE = 0xffffffffu;
const uint OCC_RES = 128, TOUCH = 8, SUM_KINDS = 16;

layout(std430, binding = 0) readonly buffer Settings {
    uint n_rays, n_groups, panel_cap, levels, enc_rows, density_width, colour_width, colour_in;
    uint n_weights, n_values, table_levels, softplus;
    uint step, background, has_hints, has_measured, has_planes, terms;
    uint opens, open_steps, dither, support_cells;
    uint effects, projects, effects_by_processor, n_photos, at_shared;
    uint at_appearance, column_appearance, at_sky, at_sky_head, at_exposure, constants_exposure;
    uint at_transient, at_transient_head, at_pose, constants_pose;
    uint seed[2], n_sparse, has_uv, depth_along_ray, stereo, no_sky;
    float near_t, log_ratio;
    float far_t, ratio, march_step, inv_extent, late, cue_weight, cue_deviation, prior_weight;
    float pose_keep, remembered, cell_decay;
    float to_mean[3], from_mean[3], from_m[3];
    float rate_weights, rate_others, rate_table, beta1, beta2, epsilon, decay;
    float srgb[9]; // from ACEScg, row-major
} s;

// Index of a row's value in panels of so many rows.
uint at_lane(uint lane, uint row, uint rows)
{
    return (lane / PANEL * rows + row) * PANEL + lane % PANEL;
}
uint panels_of(uint samples)
{
    return (samples + PANEL - 1) / PANEL;
}
uint columns()
{
    return s.colour_in - GEO;
}

// Rows of a live sample's activations, in the order in which the networks run ...
uint row_hidden()
{
    return s.enc_rows;
}
uint row_in()
{
    return s.enc_rows + s.density_width;
}
uint row_colour0()
{
    return row_in() + s.colour_in;
}
uint row_colour1()
{
    return row_colour0() + s.colour_width;
}
uint act_rows()
{
    return row_colour1() + s.colour_width;
}
// ... and of their gradients: of colour 1, colour 0, the colour's input, the hidden layer of the density; first 4 of the
// output.
uint d_row_colour1()
{
    return 4;
}
uint d_row_colour0()
{
    return 4 + s.colour_width;
}
uint d_row_in()
{
    return 4 + 2 * s.colour_width;
}
uint d_row_hidden()
{
    return d_row_in() + s.colour_in;
}
uint d_act_rows()
{
    return d_row_hidden() + s.density_width;
}
// Where the matrices begin among the weights.
uint at_density1()
{
    return s.density_width * s.enc_rows;
}
uint at_colour0()
{
    return at_density1() + GEO * s.density_width;
}
uint at_colour1()
{
    return at_colour0() + s.colour_width * s.colour_in;
}
uint at_colour2()
{
    return at_colour1() + s.colour_width * s.colour_width;
}

// The derivative of light(), from the light.
float light_gradient(float y)
{
    return y < 1 ? y : 1;
}

// A ray as nine floats: origin, direction in box units, direction in the world.
#define RAY_ORIGIN(i) vec3(ray[9 * (i)], ray[9 * (i) + 1], ray[9 * (i) + 2])
#define RAY_DIR(i) vec3(ray[9 * (i) + 3], ray[9 * (i) + 4], ray[9 * (i) + 5])
#define RAY_WORLD(i) vec3(ray[9 * (i) + 6], ray[9 * (i) + 7], ray[9 * (i) + 8])
#define RAY_Z(i) ray[9 * (i) + 8]

// Scale of the contraction of a place in box units.
float contraction(vec3 x)
{
    const float m = max(abs(x.x), max(abs(x.y), abs(x.z)));
    precise const float scale = m > 1 ? (2 - 1 / m) / m : 1;
    return scale;
}
// Cell of the occupancy grid of a place in [0, 1].
uint cell_of(vec3 u)
{
    const uvec3 c = uvec3(clamp(u * float(OCC_RES), vec3(0), vec3(OCC_RES - 1)));
    return c.x + OCC_RES * (c.y + OCC_RES * c.z);
}
