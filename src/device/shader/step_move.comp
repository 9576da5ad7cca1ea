#version 460
// Moves the rays as their photos' poses are refined, before they are marched (src/effect/pose_refinement.c). Exactly as
// the processor does, so that both march alike.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "effects.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Values { float value[]; };
layout(std430, binding = 2) readonly buffer Constants { float constant[]; };
layout(std430, binding = 3) readonly buffer RayPhoto { uint ray_photo[]; };
layout(std430, binding = 4) buffer Rays { float ray[]; };

void main()
{
    const uint r = gl_GlobalInvocationID.x;
    if (r >= s.n_rays) return;
    const uint at = s.at_pose + POSE_ROW * ray_photo[r];
    const bool has_run = constant[s.constants_pose + ray_photo[r]] > 0;
    precise float w[6];
    for (uint c = 0; c < 6; c++)
        w[c] = value[at + c] + (has_run ? value[at + 6 + c] : 0);
    const vec3 d = RAY_WORLD(r);
    precise const float turn[3] = { w[1] * d.z - w[2] * d.y, w[2] * d.x - w[0] * d.z, w[0] * d.y - w[1] * d.x };
    for (uint a = 0; a < 3; a++) {
        precise const float origin = (ray[9 * r + a] * s.to_mean[a] + MOVE * w[3 + a]) * s.from_mean[a];
        precise const float dir = (d[a] + turn[a]) * s.from_m[a];
        ray[9 * r + a] = origin;
        ray[9 * r + 3 + a] = dir;
    }
}
