#version 460
// Density logits of all samples.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(std430, binding = 1) readonly buffer Weights { vec4 weights[]; };
layout(std430, binding = 2) readonly buffer Counts { uint n_panels; };
layout(std430, binding = 3) readonly buffer Enc { float enc[]; };
layout(std430, binding = 4) writeonly buffer Logit { float logit[]; };
#include "network.glsl"

void main()
{
    const uint lane = gl_GlobalInvocationID.x;
    if (lane >= n_panels * PANEL) return;
    for (uint r = 0; r < s.enc_rows; r++)
        act[at(0, r)] = enc[at_lane(lane, r, s.enc_rows)];
    dense(0, s.density_width, s.enc_rows, 0, true);
    dense(at_density1(), GEO, s.density_width, 1, false);
    logit[lane] = act[at(0, 0)];
}
