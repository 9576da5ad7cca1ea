#version 460
// What depth and normal maps say of the rays of a group (cn_sampler_read_depth and cn_sampler_read_normals in
// src/train). All of it is in the camera's frame, where the maps are.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "rng.glsl"
#include "photos.glsl"
layout(local_size_x = 32) in;
layout(std430, binding = 6) readonly buffer Drawn { uint drawn[]; };
layout(std430, binding = 7) readonly buffer RayPhoto { uint ray_photo[]; };
layout(std430, binding = 8) readonly buffer Target { vec4 target[]; };
layout(std430, binding = 9) readonly buffer SkyHint { uint sky_hint[]; };
layout(std430, binding = 10) writeonly buffer Measured { float measured[]; };
layout(std430, binding = 11) writeonly buffer PlaneLog { float plane_log[]; };
layout(std430, binding = 12) writeonly buffer PlaneWidth { float plane_width[]; };
layout(std430, binding = 13) writeonly buffer FirstT { float first_t[]; };

const uint SHOWN = 2; // sky
const float AGREE = 0.9, FACING = 0.1;

float measured_of(uint r, Photo p, uvec2 at)
{
    if (!(p.depth_scale > 0) || p.depths == NO_MAP || !(target[r].w > 0)) return 0;
    // Stereo's windows reach over the edge of a roof into the sky.
    if (s.stereo != 0 && s.has_hints != 0 && (sky_hint[r >> 2] >> 8 * (r & 3) & 255) == SHOWN) return 0;
    const uvec2 place = at * uvec2(p.depth_width, p.depth_height) / uvec2(p.width, p.height);
    const float value = uintBitsToFloat(map_word(p.depths, place.y * p.depth_width + place.x));
    const float along = p.depth_scale * value + p.depth_shift;
    if (!(value > 0 && along > 0)) return 0;
    return s.depth_along_ray != 0 || p.sphere != 0 ? along : along / direction_at(p, at).z;
}

vec3 normal_at(Photo p, uvec2 at)
{
    const int packed = int(map_word(p.normals, pixel_at(p, at)));
    return vec3(packed << 24 >> 24, packed << 16 >> 24, packed << 8 >> 24) / 127;
}

// log(a / b) from a, b and their difference, for a and b that are nearly equal too.
float log_of_ratio(float a, float b, float difference)
{
    const float z = difference / (a + b), q = z * z;
    if (abs(z) > 0.1) return log(a / b);
    return 2 * z * (1 + q * (1.0 / 3 + q * (0.2 + q * (1.0 / 7 + q / 9))));
}

// The plane of a pair of neighbours: log-distance of the first less that of the second, and the change of it for a turn
// of the plane by one radian. False: there is none.
bool plane_of(uint r, Photo p, out float difference, out float width)
{
    if (ray_photo[r] != ray_photo[r + 1] || p.normals == NO_MAP) return false;
    if (!(target[r].w > 0 && target[r + 1].w > 0)) return false;
    const uvec2 first = unpack_pixel(drawn[r]), second = unpack_pixel(drawn[r + 1]);
    const vec3 a = normal_at(p, first), b = normal_at(p, second), mean = a + b;
    const float squared = dot(a, a) * dot(b, b);
    if (!(squared > 0) || !(dot(a, b) > AGREE * sqrt(squared))) return false;
    const vec3 from = direction_at(p, first), to = direction_at(p, second), unit = mean / sqrt(dot(mean, mean));
    const float cosine = -dot(unit, from), other = -dot(unit, to);
    if (!(cosine > FACING && other > FACING)) return false;
    difference = -log_of_ratio(cosine, other, dot(unit, to - from));
    width = sqrt(dot(to - from, to - from)) / (cosine * other);
    return true;
}

void main()
{
    const uint r = gl_GlobalInvocationID.x;
    const Photo p = photos[ray_photo[r]];
    if (s.has_measured != 0) measured[r] = measured_of(r, p, unpack_pixel(drawn[r]));
    if (s.has_planes == 0) return;
    const bool second = may_be_neighbour(r);
    float difference = 0, width = 0;
    const bool has = r % 4 >= 2 && plane_of(second ? r - 1 : r, p, difference, width);
    plane_log[r] = !has ? 0 : second ? -difference : difference;
    plane_width[r] = has ? width : 0;
    // Two rays on one plane begin alike, so that the march's steps do not tilt the plane.
    if (has && second) first_t[r] = first_of(r - 1);
}
