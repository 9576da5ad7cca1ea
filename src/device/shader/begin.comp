#version 460
// Sets the sizes of the next dispatches. Phase 0 starts a round. Phase 1, after the march through several parts, leaves
// out the parts without samples. Phase 2 starts the colours of the round.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
layout(local_size_x = 1) in;

uint groups(uint n, uint size)
{
    return (n + size - 1) / size;
}

void start()
{
    const uint n = going.n_out;
    going.n_in = n;
    going.n_out = 0;
    going.n_visible = 0;
    going.present = 0;
    going.groups_ray = uvec4(groups(n, 64), 1, 1, 0);
    for (uint p = 0; p < push.parts; p++) {
        going.groups_level[p] = uvec4(groups(n * ROUND, 64), parts[p].levels, 1, 0);
        going.groups_sample[p] = uvec4(groups(n * ROUND, push.lanes), 1, 1, 0);
    }
}

void main()
{
    if (push.phase == 0) start();
    if (push.phase == 2) going.groups_visible = uvec4(groups(going.n_visible, push.lanes), 1, 1, 0);
    for (uint p = 0; p < push.parts && push.phase == 1; p++)
        if ((going.present >> p & 1) == 0) going.groups_level[p].x = going.groups_sample[p].x = 0;
}
