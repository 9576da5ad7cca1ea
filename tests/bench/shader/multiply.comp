// Multiply-adds in registers: 64 operations a thread and turn.
#version 450
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint TURNS = 1;
layout(set = 0, binding = 0) readonly buffer From { vec4 from[]; };
layout(set = 0, binding = 1) writeonly buffer To { vec4 to[]; };

void main()
{
    const vec4 m = from[0] * 1e-3 + 0.5, c = from[1] * 1e-3 + 0.25;
    vec4 a[8];
    for (int i = 0; i < 8; i++)
        a[i] = vec4(gl_GlobalInvocationID.x + i);
    for (uint k = 0; k < TURNS; k++)
        for (int i = 0; i < 8; i++)
            a[i] = fma(a[i], m, c);
    vec4 sum = vec4(0);
    for (int i = 0; i < 8; i++)
        sum += a[i];
    to[gl_GlobalInvocationID.x] = sum;
}
