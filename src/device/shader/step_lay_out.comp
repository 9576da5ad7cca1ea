#version 460
// Gives each group its panels, until none is left, and counts rays and samples.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 256) in;
layout(std430, binding = 1) readonly buffer Target { vec4 target[]; };
layout(std430, binding = 2) readonly buffer RaySamples { uint ray_samples[]; };
layout(std430, binding = 3) readonly buffer GroupSamples { uint group_samples[]; };
layout(std430, binding = 4) writeonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 5) writeonly buffer GroupLive { uint group_live[]; };
layout(std430, binding = 6) writeonly buffer Counts { uint n_panels, kept_rays, marched_rays, samples; } counts;
shared uint of_group[256], kept[256], marched[256], panel[256];

void main()
{
    const uint g = gl_LocalInvocationID.x;
    of_group[g] = kept[g] = marched[g] = 0;
    if (g < s.n_groups) {
        of_group[g] = group_samples[g];
        for (uint r = g * GROUP; r < (g + 1) * GROUP; r++) {
            kept[g] += target[r].w > 0 ? 1 : 0;
            marched[g] += ray_samples[r] > 0 ? 1 : 0;
        }
    }
    barrier();
    if (g == 0) {
        uint n = 0, k = 0, m = 0, sum = 0;
        for (uint i = 0; i < s.n_groups; i++) {
            const uint wanted = panels_of(of_group[i]);
            const bool fits = n + wanted <= s.panel_cap;
            panel[i] = fits ? n : NONE;
            if (!fits) continue;
            n += wanted;
            sum += of_group[i];
            k += kept[i];
            m += marched[i];
        }
        counts.n_panels = n;
        counts.kept_rays = k;
        counts.marched_rays = m;
        counts.samples = sum;
    }
    barrier();
    if (g >= s.n_groups) return;
    group_panel[g] = uvec2(panel[g], panel[g] == NONE ? NONE : 0);
    group_live[g] = 0;
}
