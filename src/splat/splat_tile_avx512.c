/* AVX-512 F, BW, DQ, VL. Compiled with these flags; called only when the processor has them. */
#include "kernel/vec_avx512.h"

/* The sum of a vector's two halves. */
static inline __m256 v_halves(vf x)
{
    return _mm256_add_ps(_mm512_castps512_ps256(x), _mm512_extractf32x8_ps(x, 1));
}

#include "splat/splat_tile_simd.h"

bool cn_splat_kernel_fill_avx512(cn_splat_kernel *k)
{
    if (!__builtin_cpu_supports("avx512f") || !__builtin_cpu_supports("avx512bw") ||
        !__builtin_cpu_supports("avx512dq") || !__builtin_cpu_supports("avx512vl"))
        return false;
    *k = (cn_splat_kernel){ "avx512", simd_forward, simd_backward };
    return true;
}
