#version 460
// Gradients of each ray's conditioning: the sum over its live samples.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Spans { vec4 span[]; };
layout(std430, binding = 2) readonly buffer DActs { float d_acts[]; };
layout(std430, binding = 3) writeonly buffer DColumns { float d_columns[]; };

void main()
{
    const uint k = gl_GlobalInvocationID.x, r = k / max(columns(), 1), c = k % max(columns(), 1);
    if (r >= s.n_rays || columns() == 0) return;
    const uint first = floatBitsToUint(span[r].x), n = floatBitsToUint(span[r].y);
    float sum = 0;
    for (uint i = first; i < first + n; i++)
        sum += d_acts[i * d_act_rows() + d_row_in() + GEO + c];
    d_columns[k] = sum;
}
