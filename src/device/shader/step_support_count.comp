#version 460
// How many rays saw a cell after the last one of another photo.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "support.glsl"
layout(std430, binding = 6) readonly buffer Last { uint last[]; };
layout(std430, binding = 7) buffer Count { uint count[]; };

void main()
{
    uint r, lane, end, cell = NONE;
    samples_of(r, lane, end);
    for (; lane < end; lane++)
        if (sees(lane, cell) && r + 1 > last[cell] >> 16) atomicAdd(count[cell], 1);
}
