#version 460
// Marches each ray through the occupancy grids, until a round is full or the ray ends. All parts share one grid of t.
// Where several have a share of a place, their samples there are next to each other, and in the same round.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "shares.glsl"
layout(local_size_x = 64) in;

const uint RES = 128;

// Whether a part has a sample of a ray at t. x, y, z: the contracted place; w: the length of the step.
bool is_there(uint ray, uint part, float t, out vec4 where)
{
    const Ray r = rays[ray * push.parts + part];
    if (!(t >= r.begin && t < r.end)) return false;
    precise const vec3 x = r.origin + t * r.dir;
    const float m = max(abs(x.x), max(abs(x.y), abs(x.z)));
    precise const float s = m > 1 ? (2 - 1 / m) / m : 1;
    precise const vec3 u = x * s * 0.25 + 0.5;
    const uvec3 cell = uvec3(clamp(u * float(RES), vec3(0), vec3(RES - 1)));
    const uint bit = cell.x + RES * (cell.y + RES * cell.z);
    where = vec4(u, push.step * t * parts[part].inv_extent * s);
    return (occupancy[part * (RES * RES * RES / 32) + (bit >> 5)] >> (bit & 31) & 1) != 0;
}

void main()
{
    const uint i = gl_GlobalInvocationID.x;
    if (i >= going.n_in) return;
    const uint ray = ray_of(i);
    const State s = states[ray];
    float at = s.at;
    uint n = 0, present = 0;
    for (; at < s.end && n < ROUND; at *= push.ratio) {
        const vec2 on_map = at * vec2(s.dir_x, s.dir_y);
        float least = 0, sum = 1;
        uint group = 0;
        if (push.parts > 1) weigh(on_map, least, sum);
        for (uint p = 0; p < push.parts && n + group <= ROUND; p++) {
            const float share = push.parts > 1 ? square_share(p, distance_to(p, on_map), least) / sum : 1;
            vec4 where;
            if (!(share > 0) || !is_there(ray, p, at, where)) continue;
            if (n + group < ROUND) {
                samples[i * ROUND + n + group] = uvec2(floatBitsToUint(at), p);
                place[i * ROUND + n + group] = vec4(where.xyz, where.w * share);
            }
            group++;
            present |= 1 << p;
        }
        if (n + group > ROUND) break;
        n += group;
    }
    states[ray].at = at;
    states[ray].count = n;
    atomicAdd(going.n_samples, n);
    if (push.parts > 1) atomicOr(going.present, present);
}
