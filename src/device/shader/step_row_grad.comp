#version 460
// Gradients of the photos' rows, for each slot of groups. A thread does one column of the rows of every fourth photo,
// over the rays in order.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "effects.glsl"
layout(local_size_x = 64, local_size_y = 4) in;
layout(std430, binding = 1) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 2) readonly buffer GroupSamples { uint group_samples[]; };
layout(std430, binding = 3) readonly buffer RayPhoto { uint ray_photo[]; };
layout(std430, binding = 4) readonly buffer Constants { float constant[]; };
layout(std430, binding = 5) readonly buffer KeptD { float kept_d[]; };
layout(std430, binding = 6) readonly buffer DColumns { float d_columns[]; };
layout(std430, binding = 7) readonly buffer Rays { float ray[]; };
layout(std430, binding = 8) readonly buffer DRays { vec4 d_rays[]; };
layout(std430, binding = 9) buffer SlotGrad { float slot_grad[]; };

// Column c of the gradient of a photo's pose, and of its run's (src/effect/pose_refinement.c).
float pose_grad(uint r, uint c)
{
    if (c >= 6 && !(constant[s.constants_pose + ray_photo[r]] > 0)) return 0;
    return c % 6 < 3 ? cross(RAY_WORLD(r), d_rays[2 * r + 1].xyz)[c % 3] : MOVE * d_rays[2 * r][c % 3];
}

void main()
{
    const uint slot = gl_WorkGroupID.x;
    const uint effect_of[5] = { APPEARANCE, SKY, EXPOSURE, TRANSIENT, POSE };
    const uint width_of[5] = { APPEARANCE_CODE, SKY_CODE, 1, TRANSIENT_CODE, POSE_ROW };
    const uint at_of[5] = { s.at_appearance, s.at_sky, s.at_exposure, s.at_transient, s.at_pose };
    const uint d_of[5] = { 0, D_SKY_CODE, D_GAIN, D_TRANSIENT_CODE, 0 };
    uint c = gl_LocalInvocationID.x, e = 0;
    while (e < 5 && c >= width_of[e])
        c -= width_of[e++];
    if (e == 5 || !is_on(effect_of[e])) return;
    for (uint g = slot; g < s.n_groups; g += SLOTS) {
        if (group_panel[g].x == NONE || (group_samples[g] == 0 && s.background == 0)) continue;
        for (uint i = 0; i < GROUP; i++) {
            const uint r = g * GROUP + i;
            if (ray_photo[r] % 4 != gl_LocalInvocationID.y) continue;
            const float d = e == 0   ? d_columns[r * columns() + s.column_appearance + c]
                            : e == 4 ? pose_grad(r, c)
                                     : kept_d[(g * ROWS_D + d_of[e] + c) * GROUP + i];
            slot_grad[slot * s.n_values + at_of[e] + ray_photo[r] * width_of[e] + c] += d;
        }
    }
}
