#version 460
// The density network. Input: the encoding. One hidden layer. Output: geometry features.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "network.glsl"

void main()
{
    const uint slot = gl_GlobalInvocationID.x, i = slot / ROUND;
    if (i >= going.n_in || slot % ROUND >= states[ray_of(i)].count) return;
    for (uint r = 0; r < push.enc_rows; r++)
        act[at(0, r)] = r < 2 * push.levels ? encoding[r * slots() + slot] : 0;
    dense(0, push.density_width, push.enc_rows, 0, true);
    dense(push.density_width * push.enc_rows, GEO, push.density_width, 1, false);
    for (uint r = 0; r < GEO; r++)
        feature[r * slots() + slot] = act[at(0, r)];
}
