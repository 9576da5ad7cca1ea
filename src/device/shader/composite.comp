#version 460
// Composites a round of samples of each ray, front to back. Samples at the same t are one step through several parts:
// their optical depths add up, and each takes its proportion of the weight. A weight that is too small to need a colour
// is added to the part's next sample.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
layout(local_size_x = 64) in;

const float MAX_LOGIT = 15;

// log(1 + x) for x in (0, 1]. It stays exact for a small x, which 1 + x would round away.
float log1p(float x)
{
    return x < 1e-3 ? x - 0.5 * x * x : log(1 + x);
}

float density(float logit, uint part)
{
    const float x = min(logit, MAX_LOGIT);
    return parts[part].softplus == 0 ? exp(x) : max(x, 0) + log1p(exp(-abs(x)));
}
float optical_depth(uint slot)
{
    return density(feature[slot], part_of(slot)) * place[slot].w;
}

// Where in a step of this optical depth light ends, on average: -1/2 at its beginning, 1/2 at its end. A series where
// the two fractions would cancel.
float mean_in_step(float depth)
{
    const float tau = min(depth, 60);
    if (tau < 0.25) return -tau / 12 + tau * tau * tau / 720;
    return 1 / tau - 1 / (exp(tau) - 1) - 0.5;
}

void take_weight(uint ray, uint slot, float weight)
{
    const uint at = ray * push.parts + part_of(slot);
    const float carried = sums[at].carried + weight;
    const bool shown = carried > push.min_weight;
    sums[at].weight += weight;
    sums[at].carried = shown ? 0 : carried;
    if (!shown) return;
    colour[slot].w = carried;
    visible[atomicAdd(going.n_visible, 1)] = slot;
}

void main()
{
    const uint i = gl_GlobalInvocationID.x;
    if (i >= going.n_in) return;
    const uint ray = ray_of(i);
    State s = states[ray];
    for (uint k = 0; k < s.count; k++)
        colour[i * ROUND + k] = vec4(0);
    for (uint k = 0, n; k < s.count && s.transmittance > push.min_transmittance; k += n) {
        const uint slot = i * ROUND + k;
        const float t = t_of(slot);
        float depth = optical_depth(slot);
        for (n = 1; k + n < s.count && t_of(slot + n) == t; n++)
            depth += optical_depth(slot + n);
        const float before = s.transmittance, after = before * exp(-depth), weight = before - after;
        const float where = push.fine_depth == 0 ? t : t * (1 + push.step * mean_in_step(depth));
        if (push.depth_left > 0 && after <= push.depth_left && before > push.depth_left) s.surface = where;
        s.transmittance = after;
        s.depth += weight * where;
        if (n == 1)
            take_weight(ray, slot, weight);
        else
            for (uint j = 0; j < n; j++)
                take_weight(ray, slot + j, depth > 0 ? weight * (optical_depth(slot + j) / depth) : 0);
    }
    states[ray] = s;
}
