#version 460
// Adds the sky of each part behind its ray, in the proportion of the part's share of the place where the ray ends: a
// small network of the direction, and the code of the light (src/effect/sky.c).
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "shares.glsl"
layout(local_size_x = 64) in;

const uint IN = 16, WIDTH = 32, OUT = 4;
const float SLOPE = 0.3;

float light(float x)
{
    return x < 0 ? exp(x) : 1 + min(x, 1e6);
}

// Real spherical harmonics up to degree 3, as cn_rays_harmonics has them, times what the sky gives each degree.
void see(vec3 d, out float x[IN])
{
    const float xx = d.x * d.x, yy = d.y * d.y, zz = d.z * d.z;
    x[0] = 0.28209479;
    x[1] = -0.48860251 * d.y;
    x[2] = 0.48860251 * d.z;
    x[3] = -0.48860251 * d.x;
    x[4] = 1.09254843 * d.x * d.y;
    x[5] = -1.09254843 * d.y * d.z;
    x[6] = 0.94617470 * zz - 0.31539157;
    x[7] = -1.09254843 * d.x * d.z;
    x[8] = 0.54627422 * (xx - yy);
    x[9] = 0.59004359 * d.y * (-3 * xx + yy);
    x[10] = 2.89061144 * d.x * d.y * d.z;
    x[11] = 0.45704580 * d.y * (1 - 5 * zz);
    x[12] = 0.37317633 * d.z * (5 * zz - 3);
    x[13] = 0.45704580 * d.x * (1 - 5 * zz);
    x[14] = 1.44530572 * d.z * (xx - yy);
    x[15] = 0.59004359 * d.x * (-xx + 3 * yy);
    for (uint k = 1; k < IN; k++)
        x[k] *= k < 4 ? 0.5 : k < 9 ? 0.25 : 0.125;
}

vec3 logits(uint part, vec3 d)
{
    float x[IN], h[WIDTH], out_[3] = { 0, 0, 0 };
    see(d, x);
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
    const float up = clamp((d.z + 0.15) / 0.15, 0, 1), cover = up * up * (3 - 2 * up);
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
        rgb[c] = light(logit[c] + parts[part].sky_code[c] + SLOPE * slope);
    }
    sums[ray * push.parts + part].rgb += s.transmittance * share * cover * rgb;
}
