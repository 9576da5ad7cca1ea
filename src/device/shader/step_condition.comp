#version 460
// What the colour network is told about each ray: harmonics of its direction, and its photo's appearance.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "effects.glsl"
#include "sky.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Values { float value[]; };
layout(std430, binding = 2) readonly buffer Rays { float ray[]; };
layout(std430, binding = 3) readonly buffer RayPhoto { uint ray_photo[]; };
layout(std430, binding = 4) writeonly buffer Conditioning { float conditioning[]; };

void main()
{
    const uint r = gl_GlobalInvocationID.x;
    if (r >= s.n_rays) return;
    if (is_on(DIRECTIONS)) {
        float h[16];
        harmonics_of(RAY_WORLD(r), h);
        for (uint c = 0; c < 16; c++)
            conditioning[r * columns() + c] = h[c];
    }
    for (uint c = 0; c < APPEARANCE_CODE && is_on(APPEARANCE); c++)
        conditioning[r * columns() + s.column_appearance + c] =
            value[s.at_appearance + ray_photo[r] * APPEARANCE_CODE + c];
}
