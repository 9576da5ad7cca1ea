#version 460
// Density logits of all samples.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(std430, binding = 1) readonly buffer Weights { vec4 weights[]; };
layout(std430, binding = 2) readonly buffer Counts { uint n_panels; };
layout(std430, binding = 3) readonly buffer Enc { float enc[]; };
layout(std430, binding = 4) writeonly buffer Logit { float logit[]; };
#include "layers.glsl"
#include "encoding.glsl"

void main()
{
    const uint lane = gl_GlobalInvocationID.x;
    if (gl_WorkGroupID.x * LANES >= n_panels * PANEL) return; // all threads
    const bool used = lane < n_panels * PANEL;
    take_encoding(lane, used, s.enc_rows);
    dense(0, s.density_width, s.enc_rows, 0, true);
    dense(at_density1(), GEO, s.density_width, 1, false);
    if (used) logit[lane] = ACT(0, 0);
}
