#version 460
// The new state of the cells that the rays saw. Of the rays that saw a cell, one thread takes what is known of it.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "support.glsl"
layout(std430, binding = 6) readonly buffer RayPhoto { uint ray_photo[]; };
layout(std430, binding = 7) buffer Last { uint last[]; };
layout(std430, binding = 8) buffer Count { uint count[]; };
layout(std430, binding = 9) buffer Photo { float photo_of[]; };
layout(std430, binding = 10) buffer Since { float since[]; };
layout(std430, binding = 11) buffer Times { float times[]; };

void main()
{
    uint r, lane, end, cell = NONE;
    samples_of(r, lane, end);
    for (; lane < end; lane++) {
        if (!sees(lane, cell)) continue;
        const uint rays = atomicExchange(last[cell], 0);
        if (rays == 0) continue;
        const float photo = float(ray_photo[(rays & HALF) - 1] + 1), n = float(count[cell]);
        const bool changed = rays >> 16 != 0 || photo_of[cell] != photo;
        if (changed) since[cell] = max(since[cell], float(s.step));
        times[cell] = changed ? n : times[cell] + n;
        photo_of[cell] = photo;
        count[cell] = 0;
    }
}
