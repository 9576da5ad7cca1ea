#version 460
// What the effects ask of the photos' rows after a step (`project` in src/effect): the rows of a capture run are drawn
// together, the mean is taken away, and moves of cameras lose their trends. A group of threads does a column of the
// rows.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "effects.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Run { float run_of[]; };
layout(std430, binding = 2) readonly buffer Constants { float constant[]; };
layout(std430, binding = 3) readonly buffer Trend { float trend[]; };
layout(std430, binding = 4) coherent buffer Values { float value[]; };
layout(std430, binding = 5) buffer RunMean { float run_mean[]; }; // [column][photo]
shared float part[64];

const float RUN_DRAW = 0.03;
bool projects(uint effect)
{
    return (s.projects & effect) != 0;
}

// The column's first value, values from a photo's to the next one's, and this thread's first photo.
uint first, width, thread;

float run(uint photo, bool pose)
{
    return pose ? constant[s.constants_pose + photo] : run_of[photo];
}

void draw_together(bool pose, float by)
{
    const uint kept = gl_WorkGroupID.x * s.n_photos;
    for (uint p = thread; p < s.n_photos; p += 64) {
        float sum = 0, n = 0;
        for (uint q = 0; q < s.n_photos; q++) {
            const bool same = run(q, pose) == run(p, pose);
            sum += same ? value[first + q * width] : 0;
            n += same ? 1 : 0;
        }
        run_mean[kept + p] = sum / n;
    }
    barrier();
    for (uint p = thread; p < s.n_photos; p += 64) {
        const float v = value[first + p * width];
        if (run(p, pose) >= 1) value[first + p * width] = v + by * (run_mean[kept + p] - v);
    }
}

// The sum over all threads.
float sum_of(float x)
{
    barrier();
    part[thread] = x;
    barrier();
    float sum = 0;
    for (uint k = 0; k < 64; k++)
        sum += part[k];
    return sum;
}

void take_mean_away()
{
    float sum = 0;
    for (uint p = thread; p < s.n_photos; p += 64)
        sum += value[first + p * width];
    sum = sum_of(sum);
    for (uint p = thread; p < s.n_photos; p += 64)
        value[first + p * width] -= sum / float(s.n_photos);
}

void take_trend_away(uint axis)
{
    float slope = 0;
    for (uint p = thread; p < s.n_photos; p += 64)
        slope += trend[3 * p + axis] * value[first + p * width];
    slope = sum_of(slope);
    for (uint p = thread; p < s.n_photos; p += 64)
        value[first + p * width] -= slope * trend[3 * p + axis];
}

void refine_pose(uint c)
{
    for (uint p = thread; p < s.n_photos; p += 64)
        value[first + p * width] *= s.pose_keep;
    memoryBarrierBuffer();
    barrier();
    if (c >= 6) draw_together(true, 1);
    take_mean_away();
    for (uint axis = 0; axis < 3 && c >= 3 && c < 6; axis++)
        take_trend_away(axis);
}

void main()
{
    const uint effect_of[4] = { APPEARANCE, SKY, EXPOSURE, POSE };
    const uint width_of[4] = { APPEARANCE_CODE, SKY_CODE, 1, POSE_ROW };
    const uint at_of[4] = { s.at_appearance, s.at_sky, s.at_exposure, s.at_pose };
    uint c = gl_WorkGroupID.x, e = 0;
    while (e < 3 && c >= width_of[e])
        c -= width_of[e++];
    if (!projects(effect_of[e])) return; // all threads of the group
    first = at_of[e] + c;
    width = width_of[e];
    thread = gl_LocalInvocationID.x;
    if (effect_of[e] == POSE) {
        refine_pose(c);
        return;
    }
    if (effect_of[e] == EXPOSURE && !projects(GAINS_LEARNED)) return;
    if (effect_of[e] == SKY || (effect_of[e] == APPEARANCE && projects(RUNS_DIFFER))) draw_together(false, RUN_DRAW);
    take_mean_away();
}
