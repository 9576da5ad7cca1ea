/* NEON: the source of the AVX2 set, compiled through SIMDe. Every 64-bit ARM processor has NEON. */
#include "kernel/vec_avx2.h"

static inline __m256 v_halves(vf x)
{
    return x;
}

#include "splat/splat_tile_simd.h"

bool cn_splat_kernel_fill_neon(cn_splat_kernel *k)
{
    *k = (cn_splat_kernel){ "neon", simd_forward, simd_backward };
    return true;
}
