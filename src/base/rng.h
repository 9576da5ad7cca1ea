/* Counter-based random numbers: the same (seed, stream, counter) gives the same bits on any thread, in any order. */
#ifndef CONURB_BASE_RNG_H
#define CONURB_BASE_RNG_H
#include <stdint.h>

/* Two rounds of a 64-bit finaliser (Stafford's Mix13) over the mixed key. */
static inline uint64_t cn_rng_mix(uint64_t x)
{
    x = (x ^ (x >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    x = (x ^ (x >> 27)) * UINT64_C(0x94d049bb133111eb);
    return x ^ (x >> 31);
}
static inline uint64_t cn_rng_u64(uint64_t seed, uint64_t stream, uint64_t counter)
{
    uint64_t key = cn_rng_mix(seed + UINT64_C(0x9e3779b97f4a7c15) * (stream + 1));
    return cn_rng_mix(key + UINT64_C(0x9e3779b97f4a7c15) * (counter + 1));
}
/* [0, 1) with 24 bits. */
static inline float cn_rng_float(uint64_t seed, uint64_t stream, uint64_t counter)
{
    return (float)(cn_rng_u64(seed, stream, counter) >> 40) * 0x1p-24f;
}
/* [0, n), n > 0. The bias is negligible for n < 2^32. */
static inline uint32_t cn_rng_below(uint64_t seed, uint64_t stream, uint64_t counter, uint32_t n)
{
    return (uint32_t)(((cn_rng_u64(seed, stream, counter) >> 32) * (uint64_t)n) >> 32);
}
#endif
