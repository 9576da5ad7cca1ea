#version 460
// Finds the live samples of a group and their weights, ray after ray. A thread does one ray: first it counts, then it
// writes behind the live samples of the rays before it.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 32) in;
layout(std430, binding = 1) readonly buffer Logit { float logit[]; };
layout(std430, binding = 2) readonly buffer Length { float length_of[]; };
layout(std430, binding = 3) readonly buffer RaySamples { uint ray_samples[]; };
layout(std430, binding = 4) readonly buffer GroupSamples { uint group_samples[]; };
layout(std430, binding = 5) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 6) readonly buffer Pos { float pos[]; };
layout(std430, binding = 7) readonly buffer MarchT { float march_t[]; };
layout(std430, binding = 8) writeonly buffer GroupLive { uint group_live[]; };
layout(std430, binding = 9) writeonly buffer VisitCell { uint visit_cell[]; };
layout(std430, binding = 10) writeonly buffer VisitSeen { float visit_seen[]; };
layout(std430, binding = 11) writeonly buffer Live { vec4 live[]; };      // weight, behind, tau gradient, distance
layout(std430, binding = 12) writeonly buffer LiveFrom { uvec2 live_from[]; }; // lane of the sample, ray
layout(std430, binding = 13) writeonly buffer Spans { vec4 span[]; };     // first lane, count, sum of weights, after
layout(std430, binding = 14) writeonly buffer PanelGroup { uint panel_group[]; };
shared uint count[GROUP];

const float MIN_WEIGHT = 1e-4, MIN_TRANSMITTANCE = 1e-4, MAX_LOGIT = 15, CELL_SIDE = 4.0 / OCC_RES;

// log(1 + x) for x in (0, 1]. It stays exact for a small x, which 1 + x would round away.
float log1p(float x)
{
    return x < 1e-3 ? x - 0.5 * x * x : log(1 + x);
}
float density(float l)
{
    const float x = min(l, MAX_LOGIT);
    return s.softplus == 0 ? exp(x) : max(x, 0) + log1p(exp(-abs(x)));
}
float density_gradient(float l, float sigma)
{
    return s.softplus == 0 ? sigma : 1 / (1 + exp(-min(l, MAX_LOGIT)));
}

void main()
{
    const uint i = gl_LocalInvocationID.x, g = gl_WorkGroupID.x, r = g * GROUP + i, panel = group_panel[g].x;
    const uint panels = panels_of(group_samples[g]);
    if (panel == NONE) {
        span[r] = vec4(0, 0, -1, 1); // no room
        return; // all threads of the group
    }
    for (uint k = i; k < panels; k += GROUP)
        panel_group[panel + k] = g;
    uint from = panel * PANEL, n = 0;
    for (uint k = g * GROUP; k < r; k++)
        from += ray_samples[k];
    const uint end = from + ray_samples[r];
    float after = 1;
    for (uint lane = from; lane < end && after > MIN_TRANSMITTANCE; lane++) {
        const float next = after * exp(-density(logit[lane]) * length_of[lane]);
        n += after - next > MIN_WEIGHT ? 1 : 0;
        after = next;
    }
    count[i] = n;
    barrier();
    uint to = panel * PANEL;
    for (uint k = 0; k < i; k++)
        to += count[k];
    const uint first = to;
    float total = 0;
    after = 1;
    for (uint lane = from; lane < end; lane++) {
        visit_cell[lane] =
            cell_of(vec3(pos[at_lane(lane, 0, 3)], pos[at_lane(lane, 1, 3)], pos[at_lane(lane, 2, 3)]));
        visit_seen[lane] = 0;
        if (!(after > MIN_TRANSMITTANCE)) continue;
        const float l = logit[lane], sigma = density(l), next = after * exp(-sigma * length_of[lane]);
        const float weight = after - next;
        visit_seen[lane] = after * (1 - exp(-sigma * CELL_SIDE));
        after = next;
        if (!(weight > MIN_WEIGHT)) continue;
        live[to] = vec4(weight, next, density_gradient(l, sigma) * length_of[lane],
                        march_t[g * GROUP_CAP + lane - panel * PANEL]);
        live_from[to] = uvec2(lane, r);
        total += weight;
        to++;
    }
    span[r] = vec4(uintBitsToFloat(first), uintBitsToFloat(to - first), total, after);
    if (i == GROUP - 1) group_live[g] = to - panel * PANEL;
}
