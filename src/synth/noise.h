/* Noise for textures, from the counter-based generator: the same place has the same value in every photo. */
#ifndef CONURB_SYNTH_NOISE_H
#define CONURB_SYNTH_NOISE_H
#include "base/rng.h"

#include <math.h>
#include <stdint.h>

static inline uint64_t cn_noise_hash(int32_t x, int32_t y, uint32_t seed)
{
    const uint64_t key = (uint64_t)(uint32_t)x << 32 | (uint32_t)y;
    return cn_rng_mix(key + UINT64_C(0x9e3779b97f4a7c15) * (seed + UINT64_C(1)));
}
/* [0, 1) of a lattice point. */
static inline float cn_noise_at(int32_t x, int32_t y, uint32_t seed)
{
    return (float)(cn_noise_hash(x, y, seed) >> 40) * 0x1p-24f;
}
/* Part k (0..3) of one hash as a number in [0, 1). */
static inline float cn_noise_part(uint64_t hash, int k)
{
    return (float)(hash >> (16 * k) & 0xffff) * 0x1p-16f;
}

/* Smooth value noise in [-1, 1] with features one unit across. */
static inline float cn_noise(float x, float y, uint32_t seed)
{
    const float fx = floorf(x), fy = floorf(y);
    const int32_t ix = (int32_t)fx, iy = (int32_t)fy;
    float u = x - fx, v = y - fy;
    u = u * u * (3 - 2 * u);
    v = v * v * (3 - 2 * v);
    const float a = cn_noise_at(ix, iy, seed), b = cn_noise_at(ix + 1, iy, seed);
    const float c = cn_noise_at(ix, iy + 1, seed), d = cn_noise_at(ix + 1, iy + 1, seed);
    const float low = a + (b - a) * u, high = c + (d - c) * u;
    return 2 * (low + (high - low) * v) - 1;
}
/* The visible fraction of a detail of this size in a pixel that covers `footprint`: 1: all, 0: none. */
static inline float cn_noise_shown(float size, float footprint)
{
    const float x = size / (footprint + 1e-6f) - 1;
    return x <= 0 ? 0 : x >= 1 ? 1 : x;
}
/* Octaves from wavelength `size` down, n of them, each gain times the last. */
typedef struct cn_octaves {
    float size, gain;
    int n;
} cn_octaves;
/* Their sum. Details that a pixel cannot show are left out. */
static inline float cn_noise_sum(float x, float y, uint32_t seed, cn_octaves octaves, float footprint)
{
    float sum = 0, amplitude = 1, size = octaves.size;
    for (int i = 0; i < octaves.n; i++) {
        const float shown = cn_noise_shown(size, footprint);
        if (shown == 0) break;
        sum += amplitude * shown * cn_noise(x / size, y / size, seed + (uint32_t)i);
        amplitude *= octaves.gain;
        size *= 0.5f;
    }
    return sum;
}
static inline float cn_clamp01(float x)
{
    return x > 0 ? (x < 1 ? x : 1) : 0;
}
/* 0 below a, 1 above b, smooth between. */
static inline float cn_smooth(float a, float b, float x)
{
    const float t = cn_clamp01((x - a) / (b - a));
    return t * t * (3 - 2 * t);
}
static inline void cn_mix3(float out[3], const float other[3], float t)
{
    for (int c = 0; c < 3; c++)
        out[c] += (other[c] - out[c]) * t;
}
static inline void cn_scale3(float out[3], float s)
{
    for (int c = 0; c < 3; c++)
        out[c] *= s;
}
#endif
