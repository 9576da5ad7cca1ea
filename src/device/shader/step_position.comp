#version 460
// Gradient of each live sample's place in box units.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "grid.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Levels { uvec4 level[]; };
layout(std430, binding = 2) readonly buffer Table { uint table[]; };
layout(std430, binding = 3) readonly buffer Counts { uint n_panels; };
layout(std430, binding = 4) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 5) readonly buffer GroupLive { uint group_live[]; };
layout(std430, binding = 6) readonly buffer PanelGroup { uint panel_group[]; };
layout(std430, binding = 7) readonly buffer LiveFrom { uvec2 live_from[]; };
layout(std430, binding = 8) readonly buffer Live { vec4 live[]; };
layout(std430, binding = 9) readonly buffer Rays { float ray[]; };
layout(std430, binding = 10) readonly buffer Enc { float enc[]; };
layout(std430, binding = 11) readonly buffer LivePos { vec4 live_pos[]; };
layout(std430, binding = 12) writeonly buffer DPlace { vec4 d_place[]; };
#include "live.glsl"

vec3 contracted_gradient(uint lane)
{
    vec3 d = vec3(0);
    for (uint w = 0; w < s.levels; w++) {
        const uvec4 l = level[w];
        const float g0 = enc[at_lane(lane, 2 * w, s.enc_rows)], g1 = enc[at_lane(lane, 2 * w + 1, s.enc_rows)];
        uvec3 corner;
        vec3 f;
        cell_at(l, live_pos[lane].xyz, corner, f);
        for (uint c = 0; c < 8; c++) {
            const uvec3 which = uvec3(c & 1, c >> 1 & 1, c >> 2);
            const vec3 k = corner_weights(c, f), sign_of = mix(vec3(-1), vec3(1), equal(which, uvec3(1)));
            const uint pair = table[l.z + entry_of(l, corner + which)];
            const float value =
                (g0 * uintBitsToFloat(pair << 16) + g1 * uintBitsToFloat(pair & 0xffff0000u)) * float(l.x);
            d += sign_of * value * vec3(k.y * k.z, k.x * k.z, k.x * k.y);
        }
    }
    return d;
}

void main()
{
    const uint lane = gl_GlobalInvocationID.x;
    uint group, place;
    if (!is_live(lane, group, place)) return;
    const uint r = live_from[lane].y;
    const vec3 x = RAY_ORIGIN(r) + live[lane].w * RAY_DIR(r), d = contracted_gradient(lane);
    // The contraction scales x by f(m), where m is the largest of |x|.
    const vec3 a = abs(x);
    const uint most = a.x >= a.y && a.x >= a.z ? 0 : a.y >= a.z ? 1 : 2;
    const float m = a[most];
    vec3 d_x = 0.25 * d;
    if (m > 1) {
        const float f = (2 - 1 / m) / m, slope = (2 / m - 2) / (m * m);
        d_x = 0.25 * f * d;
        d_x[most] += 0.25 * slope * dot(x, d) * (x[most] < 0 ? -1 : 1);
    }
    d_place[lane] = vec4(d_x, live[lane].w);
}
