#version 460
// Transposes the weights of the effects' networks, for when the processor runs them.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "effects.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Values { float value[]; };
layout(std430, binding = 2) writeonly buffer Derived { float derived[]; };

void main()
{
    uint k = gl_GlobalInvocationID.x, l, offset, rows, columns;
    Head h;
    if (!find_weight(k, h, l, offset, rows, columns)) return;
    derived[h.at - s.at_shared + offset + k % columns * rows + k / columns] = value[h.at + offset + k];
}
