#version 460
// Composites the live samples of each ray.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Live { vec4 live[]; };
layout(std430, binding = 2) readonly buffer Spans { vec4 span[]; };
layout(std430, binding = 3) readonly buffer Colour { vec4 colour[]; };
layout(std430, binding = 4) writeonly buffer Pixel { vec4 pixel[]; };

void main()
{
    const uint r = gl_GlobalInvocationID.x;
    if (r >= s.n_rays) return;
    const uint first = floatBitsToUint(span[r].x), n = floatBitsToUint(span[r].y);
    vec3 rgb = vec3(0);
    for (uint i = first; i < first + n; i++)
        rgb += live[i].x * colour[i].xyz;
    pixel[r] = vec4(rgb, span[r].w);
}
