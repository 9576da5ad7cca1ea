/* AVX2 + FMA. Compiled with -mavx2 -mfma; called only when the processor has them. */
#include "kernel/vec_avx2.h"

static inline __m256 v_halves(vf x)
{
    return x;
}

#include "splat/splat_tile_simd.h"

bool cn_splat_kernel_fill_avx2(cn_splat_kernel *k)
{
    if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) return false;
    *k = (cn_splat_kernel){ "avx2", simd_forward, simd_backward };
    return true;
}
