#version 460
// Adds the sky of each part behind its ray, in the proportion of the part's share of the place where the ray ends: a
// small network of the direction, and the code of the light (src/effect/sky.c).
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "light.glsl"
#include "shares.glsl"
#include "sky.glsl"
layout(local_size_x = 64) in;

const uint IN = 16, WIDTH = 32, OUT = 4;

vec3 logits(uint part, vec3 d)
{
    float x[IN], h[WIDTH], out_[3] = { 0, 0, 0 };
    harmonics_of(d, x);
    for (uint k = 0; k < IN; k++)
        x[k] *= sky_of_degree(k);
    for (uint o = 0; o < WIDTH; o++) {
        float sum = 0;
        for (uint k = 0; k < IN; k++)
            sum += parts[part].sky[k * WIDTH + o] * x[k];
        h[o] = max(sum, 0);
    }
    for (uint o = 0; o < WIDTH; o++) {
        float sum = 0;
        for (uint k = 0; k < WIDTH; k++)
            sum += parts[part].sky[WIDTH * IN + k * WIDTH + o] * h[k];
        for (uint c = 0; c < 3; c++)
            out_[c] += parts[part].sky[WIDTH * (IN + WIDTH) + o * OUT + c] * max(sum, 0);
    }
    return vec3(out_[0], out_[1], out_[2]);
}

void main()
{
    const uint ray = gl_GlobalInvocationID.x, part = gl_GlobalInvocationID.y;
    if (ray >= push.n_rays || parts[part].has_sky == 0) return;
    const State s = states[ray];
    const vec3 d = vec3(s.dir_x, s.dir_y, s.dir_z);
    const float cover = sky_cover(d);
    float least = 0, sum = 1, share = 1;
    if (push.parts > 1) {
        weigh(s.end * d.xy, least, sum);
        share = square_share(part, distance_to(part, s.end * d.xy), least) / sum;
    }
    if (!(s.transmittance * share * cover > 0)) return;
    const vec3 logit = logits(part, d);
    vec3 rgb;
    for (uint c = 0; c < 3; c++) {
        float slope = 0;
        for (uint k = 0; k < 3; k++)
            slope += parts[part].sky_code[3 + 3 * k + c] * d[k];
        rgb[c] = light(logit[c] + parts[part].sky_code[c] + SKY_SLOPE * slope);
    }
    sums[ray * push.parts + part].rgb += s.transmittance * share * cover * rgb;
}
