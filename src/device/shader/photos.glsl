// The photos that rays are drawn from, and their maps. src/device/step.h has the same struct and says more of it. A
// shader binds the photos at 1 and the maps at 2 to 5.
struct Photo {
    uint width, height, pixels, directions, sphere;
    uint depths, depth_width, depth_height;
    float depth_scale, depth_shift;
    uint normals, unused;
    float world_from_cam[9], origin[3];
};
layout(std430, binding = 1) readonly buffer Photos { Photo photos[]; };
layout(std430, binding = 2) readonly buffer Maps0 { uint maps0[]; };
layout(std430, binding = 3) readonly buffer Maps1 { uint maps1[]; };
layout(std430, binding = 4) readonly buffer Maps2 { uint maps2[]; };
layout(std430, binding = 5) readonly buffer Maps3 { uint maps3[]; };
const uint NO_MAP = NONE;

uint map_word(uint map, uint word)
{
    const uint block = maps0[2 * map], at = maps0[2 * map + 1] + word;
    if (block == 0) return maps0[at];
    if (block == 1) return maps1[at];
    if (block == 2) return maps2[at];
    return maps3[at];
}

// Row-major place of a pixel.
uint pixel_at(Photo p, uvec2 at)
{
    return at.y * p.width + at.x;
}
// Direction of a pixel in the camera's frame; 0: the lens has no ray there.
vec3 direction_at(Photo p, uvec2 at)
{
    const uint word = 3 * pixel_at(p, at);
    return vec3(uintBitsToFloat(map_word(p.directions, word)), uintBitsToFloat(map_word(p.directions, word + 1)),
                uintBitsToFloat(map_word(p.directions, word + 2)));
}

// In whole numbers, because devices may take the smallest halves for 0.
float float_of_half(uint h)
{
    const uint sign = (h & 0x8000) << 16, exponent = h >> 10 & 31, fraction = h & 0x3ff;
    if (exponent == 31) return uintBitsToFloat(sign | 0x7f800000 | fraction << 13);
    if (exponent > 0) return uintBitsToFloat(sign | (exponent + 112) << 23 | fraction << 13);
    const float small = float(fraction) / 16777216;
    return sign == 0 ? small : -small;
}
vec4 colour_at(Photo p, uvec2 at)
{
    const uint word = 2 * pixel_at(p, at), rg = map_word(p.pixels, word), bw = map_word(p.pixels, word + 1);
    return vec4(float_of_half(rg & 0xffff), float_of_half(rg >> 16), float_of_half(bw & 0xffff),
                float_of_half(bw >> 16));
}

// Every fourth ray may be a neighbour of the ray before it (src/train/normals.c).
bool may_be_neighbour(uint r)
{
    return r % 4 == 3;
}
uvec2 unpack_pixel(uint drawn)
{
    return uvec2(drawn & 0xffff, drawn >> 16);
}

// Where the march of ray r begins, by the random number that was drawn for it.
const uint MAX_RAYS = 8192, STREAM_JITTER = 19;
uvec2 counter_of(uint r)
{
    return add64(mul64(uvec2(s.step, 0), uvec2(MAX_RAYS, 0)), uvec2(r, 0));
}
uvec2 seed()
{
    return uvec2(s.seed[0], s.seed[1]);
}
float first_of(uint r)
{
    const float jitter = float(rng_high(seed(), STREAM_JITTER, counter_of(r)) >> 8) / 16777216;
    return s.near_t * exp(jitter * s.log_ratio);
}
