// Reads and writes memory in order: 32 bytes an element.
#version 450
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint EACH = 1;
layout(set = 0, binding = 0) readonly buffer From { vec4 from[]; };
layout(set = 0, binding = 1) writeonly buffer To { vec4 to[]; };

void main()
{
    const uint stride = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    for (uint k = 0; k < EACH; k++) {
        const uint i = gl_GlobalInvocationID.x + k * stride;
        to[i] = from[i] * 1.0001 + 0.5;
    }
}
