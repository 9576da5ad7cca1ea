#version 460
// Error of each ray's colour, display-encoded, and its gradient. Sums over the rays of a slot, in a fixed order. A
// group of threads does a slot; each thread has every 32nd ray, as its place in its group says.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 32) in;
layout(std430, binding = 1) readonly buffer Target { vec4 target[]; };
layout(std430, binding = 2) readonly buffer Counts { uint n_panels, kept_rays; };
layout(std430, binding = 3) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 4) readonly buffer Pixel { vec4 pixel[]; };
layout(std430, binding = 5) readonly buffer GroupSamples { uint group_samples[]; };
layout(std430, binding = 6) writeonly buffer DPixel { vec4 d_pixel[]; };
layout(std430, binding = 7) buffer Sums { float sums[]; };
shared vec3 part[GROUP]; // error, rays, bad rays

const float CLIPPED = 0.98;
float encode(float linear, out float gradient)
{
    gradient = 12.92;
    if (linear <= 0.0031308) return 12.92 * linear;
    const float power = pow(linear, 1 / 2.4);
    gradient = 1.055 / 2.4 * power / linear;
    return 1.055 * power - 0.055;
}

bool finite(float x)
{
    return !isnan(x) && !isinf(x);
}

float error_of(vec3 rgb, vec3 wanted, float scale, out vec3 d)
{
    float error = 0;
    d = vec3(0);
    for (uint i = 0; i < 3; i++) {
        const vec3 row = vec3(s.srgb[3 * i], s.srgb[3 * i + 1], s.srgb[3 * i + 2]);
        const float a = dot(row, rgb), b = dot(row, wanted);
        float gradient, unused;
        if (b >= CLIPPED && a >= b) continue;
        const float e = encode(a, gradient) - encode(b, unused);
        error += e * e;
        d += 2 * scale * e * gradient * row;
    }
    return error;
}

void main()
{
    const uint i = gl_LocalInvocationID.x, slot = gl_WorkGroupID.x;
    const float scale = 1.0 / (3.0 * float(max(kept_rays, 1)));
    vec3 sum = vec3(0);
    for (uint g = slot; g < s.n_groups; g += SLOTS) {
        const uint r = g * GROUP + i;
        d_pixel[r] = vec4(0);
        if (group_panel[g].x == NONE || group_samples[g] == 0 || !(target[r].w > 0)) continue;
        vec3 d;
        const float e = error_of(pixel[r].xyz, target[r].xyz, scale * target[r].w, d);
        const bool good = finite(e) && finite(d.x + d.y + d.z);
        d_pixel[r] = good ? vec4(d, 0) : vec4(0);
        sum += good ? vec3(e, 1, 0) : vec3(0, 0, 1);
    }
    part[i] = sum;
    barrier();
    if (i != 0) return;
    sum = vec3(0);
    for (uint k = 0; k < GROUP; k++)
        sum += part[k];
    sums[slot * SUM_KINDS] = sum.x;
    sums[slot * SUM_KINDS + 1] = sum.x;
    sums[slot * SUM_KINDS + 2] = sum.y;
    sums[slot * SUM_KINDS + 3] = sum.y;
    sums[slot * SUM_KINDS + 5] = sum.z;
}
