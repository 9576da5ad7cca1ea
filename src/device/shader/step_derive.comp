#version 460
// Transposes the weights of each layer.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Values { float value[]; };
layout(std430, binding = 2) writeonly buffer Derived { float derived[]; };

void main()
{
    const uint out_of[5] = { s.density_width, GEO, s.colour_width, s.colour_width, 4 };
    const uint in_of[5] = { s.enc_rows, s.density_width, s.colour_in, s.colour_width, s.colour_width };
    uint k = gl_GlobalInvocationID.x, offset = 0;
    for (uint l = 0; l < 5; l++) {
        const uint n = out_of[l] * in_of[l];
        if (k < n) {
            derived[offset + k % in_of[l] * out_of[l] + k / in_of[l]] = value[offset + k];
            return;
        }
        k -= n;
        offset += n;
    }
}
