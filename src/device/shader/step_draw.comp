#version 460
// Draws the rays of a group (cn_sampler_draw in src/train/sampler.c): a random pixel of a random photo, or of a sparse
// point; its colour, direction, and what the photo says of it. Photo and pixel are those that the processor draws.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "rng.glsl"
#include "photos.glsl"
layout(local_size_x = 32) in;
layout(std430, binding = 6) readonly buffer Sparse { uint sparse[]; };
layout(std430, binding = 7) readonly buffer SkyHints { uint sky_hints[]; };
layout(std430, binding = 8) writeonly buffer Drawn { uint drawn[]; };
layout(std430, binding = 9) writeonly buffer RayPhoto { uint ray_photo[]; };
layout(std430, binding = 10) writeonly buffer Depth { float depth[]; };
layout(std430, binding = 11) writeonly buffer Target { vec4 target[]; };
layout(std430, binding = 12) writeonly buffer Rays { float ray[]; };
layout(std430, binding = 13) writeonly buffer RayUv { vec2 ray_uv[]; };
layout(std430, binding = 14) writeonly buffer SkyHint { uint sky_hint[]; };
layout(std430, binding = 15) writeonly buffer FirstT { float first_t[]; };
shared uint hint[GROUP];

const uint STREAM_PHOTO = 16, STREAM_X = 17, STREAM_Y = 18, STREAM_NEIGHBOUR = 20;
const uint SPARSE_EVERY = 8, HINT_X = 256, HINT_Y = 192, HINT_NONE = 1;
const int REACH_PART = 64, LEAST_REACH = 2;

struct Choice {
    uint photo;
    uvec2 at;
    float distance; // of a sparse point; 0: none
};

uint draw_row(Photo p, uvec2 counter)
{
    if (p.sphere == 0) return rng_below(seed(), STREAM_Y, counter, p.height);
    const uint number = rng_high(seed(), STREAM_Y, counter) >> 8, bounds = 3 * p.width * p.height;
    uint row = 0, end = p.height;
    while (row + 1 < end) {
        const uint middle = (row + end) / 2;
        if (map_word(p.directions, bounds + middle) <= number)
            row = middle;
        else
            end = middle;
    }
    return row;
}

Choice draw_pixel(uint r)
{
    const uvec2 counter = counter_of(r);
    if (s.n_sparse > 0 && r % SPARSE_EVERY == 0) {
        const uint k = 3 * rng_below(seed(), STREAM_PHOTO, counter, s.n_sparse);
        return Choice(sparse[k], unpack_pixel(sparse[k + 1]), uintBitsToFloat(sparse[k + 2]));
    }
    const uint photo = rng_below(seed(), STREAM_PHOTO, counter, s.n_photos);
    const Photo p = photos[photo];
    return Choice(photo, uvec2(rng_below(seed(), STREAM_X, counter, p.width), draw_row(p, counter)), 0);
}

uint beside(int at, int by, int size)
{
    const int there = at + by, mirrored = at - by;
    if (there >= 0 && there < size) return there;
    return mirrored >= 0 && mirrored < size ? mirrored : at;
}

Choice draw_neighbour(uint r, Choice of)
{
    const Photo p = photos[of.photo];
    const uvec2 counter = counter_of(r);
    const int reach = max(int(p.width) / REACH_PART, LEAST_REACH);
    int dx = int(rng_below(seed(), STREAM_NEIGHBOUR, counter, 2 * reach + 1)) - reach;
    const int dy = int(rng_below(seed(), STREAM_NEIGHBOUR + 1, counter, 2 * reach + 1)) - reach;
    if (dx == 0 && dy == 0) dx = reach;
    return Choice(of.photo, uvec2(beside(int(of.at.x), dx, int(p.width)), beside(int(of.at.y), dy, int(p.height))), 0);
}

Choice choose(uint r)
{
    if (s.has_planes != 0 && may_be_neighbour(r)) {
        const Choice of = draw_pixel(r - 1);
        if (photos[of.photo].normals != NO_MAP) return draw_neighbour(r, of);
    }
    return draw_pixel(r);
}

uint hint_at(uint photo, Photo p, uvec2 at)
{
    const uint cell = (photo * HINT_Y + at.y * HINT_Y / p.height) * HINT_X + at.x * HINT_X / p.width;
    const uint found = sky_hints[cell >> 2] >> 8 * (cell & 3) & 255;
    return found == HINT_NONE ? s.no_sky : found;
}

// A ray of no weight has no direction.
void write_ray(uint r, Photo p, vec3 in_camera, bool has)
{
    for (uint a = 0; a < 3; a++) {
        const vec3 row =
            vec3(p.world_from_cam[3 * a], p.world_from_cam[3 * a + 1], p.world_from_cam[3 * a + 2]);
        const float dir = has ? dot(row, in_camera) : 0;
        ray[9 * r + a] = has ? p.origin[a] : 0;
        ray[9 * r + 3 + a] = dir * s.from_m[a];
        ray[9 * r + 6 + a] = dir;
    }
}

void main()
{
    const uint i = gl_LocalInvocationID.x, r = gl_WorkGroupID.x * GROUP + i;
    const Choice choice = choose(r);
    const Photo p = photos[choice.photo];
    vec4 colour = colour_at(p, choice.at);
    const vec3 in_camera = direction_at(p, choice.at);
    const bool has = colour.w > 0 && in_camera != vec3(0);
    if (!has) colour.w = 0;
    drawn[r] = choice.at.x | choice.at.y << 16;
    ray_photo[r] = choice.photo;
    depth[r] = choice.distance;
    target[r] = colour;
    write_ray(r, p, in_camera, has);
    if (s.has_uv != 0) ray_uv[r] = 2 * (vec2(choice.at) + 0.5) / vec2(p.width, p.height) - 1;
    first_t[r] = first_of(r);
    if (s.has_hints == 0) return; // all threads
    hint[i] = hint_at(choice.photo, p, choice.at);
    barrier();
    if (i % 4 == 0) sky_hint[r >> 2] = hint[i] | hint[i + 1] << 8 | hint[i + 2] << 16 | hint[i + 3] << 24;
}
