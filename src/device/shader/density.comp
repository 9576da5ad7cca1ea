#version 460
// The density network. Input: the encoding. One hidden layer. Output: geometry features.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "network.glsl"

void main()
{
    const uint slot = gl_GlobalInvocationID.x;
    if (!is_mine(slot)) return;
    const uint rows = parts[push.part].enc_rows, width = parts[push.part].density_width;
    for (uint r = 0; r < rows; r++)
        act[at(0, r)] = r < 2 * parts[push.part].levels ? encoding[r * slots() + slot] : 0;
    dense(0, width, rows, 0, true);
    dense(width * rows, GEO, width, 1, false);
    for (uint r = 0; r < GEO; r++)
        feature[r * slots() + slot] = act[at(0, r)];
}
