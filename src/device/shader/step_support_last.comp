#version 460
// The last ray that saw a cell, and the last one of another photo.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "support.glsl"
layout(std430, binding = 6) readonly buffer RayPhoto { uint ray_photo[]; };
layout(std430, binding = 7) coherent buffer Last { uint last[]; };

// The two rays with one more.
uint with(uint rays, uint r)
{
    uint newest = rays & HALF, other = rays >> 16;
    const bool differs = newest != 0 && ray_photo[newest - 1] != ray_photo[r];
    if (r + 1 > newest) {
        other = differs ? newest : other;
        newest = r + 1;
    } else if (differs) {
        other = max(other, r + 1);
    }
    return newest | other << 16;
}

void main()
{
    uint r, lane, end, cell = NONE;
    samples_of(r, lane, end);
    for (; lane < end; lane++) {
        if (!sees(lane, cell)) continue;
        uint was = last[cell], now = with(was, r);
        while (now != was) {
            const uint found = atomicCompSwap(last[cell], was, now);
            if (found == was) break;
            was = found;
            now = with(was, r);
        }
    }
}
