#version 460
// Composites a round of samples of each ray, front to back. A weight that is too small to need a colour is added to the
// next sample.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
layout(local_size_x = 64) in;

const float MAX_LOGIT = 15;

// log(1 + x) for x in (0, 1]. It stays exact for a small x, which 1 + x would round away.
float log1p(float x)
{
    return x < 1e-3 ? x - 0.5 * x * x : log(1 + x);
}

float density(float logit)
{
    const float x = min(logit, MAX_LOGIT);
    return push.softplus == 0 ? exp(x) : max(x, 0) + log1p(exp(-abs(x)));
}

void main()
{
    const uint i = gl_GlobalInvocationID.x;
    if (i >= going.n_in) return;
    const uint ray = ray_of(i);
    State s = states[ray];
    for (uint k = 0; k < s.count; k++) {
        const uint slot = i * ROUND + k;
        colour[slot] = vec4(0);
        if (!(s.transmittance > push.min_transmittance)) continue;
        const float depth = density(feature[slot]) * place[slot].w;
        const float before = s.transmittance, after = before * exp(-depth), weight = before - after;
        if (push.depth_left > 0 && after <= push.depth_left && before > push.depth_left) s.surface = t_at[slot];
        s.transmittance = after;
        s.depth += weight * t_at[slot];
        s.weight += weight;
        s.carried += weight;
        if (!(s.carried > push.min_weight)) continue;
        colour[slot].w = s.carried;
        visible[atomicAdd(going.n_visible, 1)] = slot;
        s.carried = 0;
    }
    states[ray] = s;
}
