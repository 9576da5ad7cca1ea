#version 460
// Sets the sizes of the next dispatches. Phase 0 starts a round. Phase 1 starts the colours of the round.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
layout(local_size_x = 1) in;

uint groups(uint n, uint size)
{
    return (n + size - 1) / size;
}

void main()
{
    if (push.phase == 1) {
        going.groups_visible = uvec4(groups(going.n_visible, push.lanes), 1, 1, 0);
        return;
    }
    const uint n = going.n_out;
    going.n_in = n;
    going.n_out = 0;
    going.n_visible = 0;
    going.groups_ray = uvec4(groups(n, 64), 1, 1, 0);
    going.groups_level = uvec4(groups(n * ROUND, 64), push.levels, 1, 0);
    going.groups_sample = uvec4(groups(n * ROUND, push.lanes), 1, 1, 0);
}
