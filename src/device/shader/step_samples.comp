#version 460
// The loss terms of a ray's samples, and the backward pass of the compositing: gradients of the density logits and of
// the colours. A thread does one ray of a group.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "sky.glsl"
layout(local_size_x = 32) in;
layout(std430, binding = 1) readonly buffer Target { vec4 target[]; };
layout(std430, binding = 2) readonly buffer Counts { uint n_panels, kept_rays; };
layout(std430, binding = 3) readonly buffer Live { vec4 live[]; };
layout(std430, binding = 4) readonly buffer Spans { vec4 span[]; };
layout(std430, binding = 5) readonly buffer Colour { vec4 colour[]; };
layout(std430, binding = 6) readonly buffer DPixel { vec4 d_pixel[]; };
layout(std430, binding = 7) readonly buffer Depth { float depth[]; };
layout(std430, binding = 8) readonly buffer Measured { float measured[]; };
layout(std430, binding = 9) readonly buffer PlaneLog { float plane_log[]; };
layout(std430, binding = 10) readonly buffer PlaneWidth { float plane_width[]; };
layout(std430, binding = 11) readonly buffer SkyHint { uint sky_hint[]; };
layout(std430, binding = 12) readonly buffer Rays { float ray[]; };
layout(std430, binding = 13) buffer Missing { uint missing[]; };
layout(std430, binding = 14) writeonly buffer DSample { vec4 d_sample[]; }; // of the colour's output, of the logit
layout(std430, binding = 15) readonly buffer SingleView { uint single_view[]; };
shared float mean_of[GROUP], total_of[GROUP];
shared uint nothing[GROUP];

const uint OPENNESS = 1, SPREAD = 2, SPARSE = 4, MEASURED = 8, CUE = 16, NORMAL = 32,
           SINGLE_VIEW = 64, GLOW = 128, GROUND = 256;
const float NEAR_BAND = 0.05, FAR = 0.7, WHOLE = 1e9;

bool on(uint term)
{
    return (s.terms & term) != 0;
}
float about(float off, float squared, float linear, float end)
{
    const float cut = min(abs(off), end);
    return squared * cut * cut + linear * abs(off);
}

void main()
{
    const uint i = gl_LocalInvocationID.x, r = gl_WorkGroupID.x * GROUP + i;
    const uint first = floatBitsToUint(span[r].x), n = floatBitsToUint(span[r].y);
    const float total = span[r].z, after = span[r].w;
    float mean = 0;
    vec3 whole = vec3(0);
    for (uint k = first; k < first + n; k++) {
        mean += live[k].x * log(live[k].w);
        whole += live[k].x * colour[k].xyz;
    }
    const float most = max(1.5, 4 * max(whole.x, max(whole.y, whole.z)));
    mean = total > 0 ? mean / total : mean;
    mean_of[i] = mean;
    total_of[i] = total;
    barrier();

    const float scale = 1.0 / float(max(kept_rays, 1));
    const bool counts = target[r].w > 0 && total >= 0, has_depth = depth[r] > 0;
    const bool has_measured = s.has_measured != 0 && measured[r] > 0;
    const float log_depth = has_depth ? log(s.late * depth[r]) : 0;
    const float log_measured = has_measured ? log(s.late * measured[r]) : 0;
    const uint other = i ^ 1;
    const bool has_plane = on(NORMAL) && s.has_planes != 0 && plane_width[r] > 0 && total > 0.5 &&
                           total_of[other] > 0.5 && abs(mean - mean_of[other]) < 0.6931472;
    float by_mean = 0;
    if (has_plane) {
        const float width = plane_width[r], angle = (mean - (mean_of[other] + plane_log[r])) / width;
        by_mean = 0.3 * scale * s.cue_weight * angle / sqrt(1 + angle * angle / 0.04) / (width * total);
    }
    float d_after = d_pixel[r].w;
    if (on(OPENNESS) && counts) d_after += scale * s.prior_weight * 0.01;
    if (on(GROUND) && counts) d_after += 2 * after * scale * s.prior_weight * 0.01 * (1 - sky_cover(RAY_WORLD(r)));
    if (on(SPARSE) && has_depth) d_after += scale * 0.1;
    if (on(MEASURED) && has_measured) d_after += scale * 0.1;

    float behind = after * d_after;
    for (uint k = first + n; k-- > first;) {
        const vec4 l = live[k];
        const float at = log(l.w);
        float d = dot(d_pixel[r].xyz, colour[k].xyz);
        if (on(SPREAD) && !has_depth)
            d += about(at - mean, scale * 0.01, scale * (s.prior_weight * 0.003), FAR);
        if (on(SPARSE) && has_depth) d += about(at - log_depth, scale * 0.1, scale * 0.2, FAR);
        if (on(MEASURED) && has_measured) {
            d += about(at - log_measured, scale * 0.1, scale * 0.2, WHOLE);
            if (at < log_measured - NEAR_BAND) d += scale * 0.1;
        }
        if (on(CUE) && has_measured)
            d += about(at - log_measured, scale * s.cue_weight * 0.1, scale * s.cue_weight * s.cue_deviation, WHOLE);
        if (has_plane) d += by_mean * (at - mean);
        if (on(SINGLE_VIEW) && single_view[k] != 0) d += scale * 0.12;
        const vec3 c = colour[k].xyz;
        vec3 d_colour = d_pixel[r].xyz;
        if (on(GLOW) && counts) {
            const vec3 over = max(c - most, vec3(0));
            d += 0.1 * scale * (over.x + over.y + over.z);
            d_colour += 0.1 * scale * vec3(greaterThan(over, vec3(0)));
        }
        const float d_tau = l.y * d - behind;
        behind += l.x * d;
        d_sample[k] = vec4(l.x * d_colour * vec3(light_gradient(c.x), light_gradient(c.y), light_gradient(c.z)),
                           d_tau * l.z);
    }

    // What reactivation has to look at. Rays without samples, or of groups without room, keep what the march noted.
    const uint was = missing[r >> 2] >> 8 * (r & 3) & 255;
    const bool shows_none = s.has_hints != 0 && (sky_hint[r >> 2] >> 8 * (r & 3) & 255) == 1;
    const bool may_be_sky = s.background != 0 && !shows_none && RAY_Z(r) > 0;
    nothing[i] = counts ? (after > 0.5 && !may_be_sky ? 1 : 0) : was;
    barrier();
    if (i % 4 == 0)
        missing[r >> 2] = nothing[i] | nothing[i + 1] << 8 | nothing[i + 2] << 16 | nothing[i + 3] << 24;
}
