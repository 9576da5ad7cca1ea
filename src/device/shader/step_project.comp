#version 460
// What the effects ask of the photos' rows after a step (`project` in src/effect): the rows of a capture run are drawn
// together, and the mean is taken away. A group of threads does a column of the rows.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "effects.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Run { float run_of[]; };
layout(std430, binding = 2) buffer Values { float value[]; };
layout(std430, binding = 3) buffer RunMean { float run_mean[]; }; // [column][photo]
shared float part[64];

const float RUN_DRAW = 0.03;

void draw_together(uint first, uint width)
{
    const uint kept = gl_WorkGroupID.x * s.n_photos;
    for (uint p = gl_LocalInvocationID.x; p < s.n_photos; p += 64) {
        float sum = 0, n = 0;
        for (uint q = 0; q < s.n_photos; q++) {
            const bool same = run_of[q] == run_of[p];
            sum += same ? value[first + q * width] : 0;
            n += same ? 1 : 0;
        }
        run_mean[kept + p] = sum / n;
    }
    barrier();
    for (uint p = gl_LocalInvocationID.x; p < s.n_photos; p += 64) {
        const float v = value[first + p * width];
        if (run_of[p] >= 1) value[first + p * width] = v + RUN_DRAW * (run_mean[kept + p] - v);
    }
}

void take_mean_away(uint first, uint width)
{
    float sum = 0;
    for (uint p = gl_LocalInvocationID.x; p < s.n_photos; p += 64)
        sum += value[first + p * width];
    part[gl_LocalInvocationID.x] = sum;
    barrier();
    sum = 0;
    for (uint k = 0; k < 64; k++)
        sum += part[k];
    for (uint p = gl_LocalInvocationID.x; p < s.n_photos; p += 64)
        value[first + p * width] -= sum / float(s.n_photos);
}

void main()
{
    uint c = gl_WorkGroupID.x;
    if (c < APPEARANCE_CODE) {
        if (!is_on(APPEARANCE)) return;
        if (is_on(RUNS_DIFFER)) draw_together(s.at_appearance + c, APPEARANCE_CODE);
        take_mean_away(s.at_appearance + c, APPEARANCE_CODE);
        return;
    }
    c -= APPEARANCE_CODE;
    if (c < SKY_CODE) {
        if (!is_on(SKY)) return;
        draw_together(s.at_sky + c, SKY_CODE);
        take_mean_away(s.at_sky + c, SKY_CODE);
        return;
    }
    if (is_on(EXPOSURE) && is_on(GAINS_LEARNED)) take_mean_away(s.at_exposure, 1);
}
