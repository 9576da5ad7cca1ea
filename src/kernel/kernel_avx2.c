/* AVX2 + FMA. Compiled with -mavx2 -mfma; called only when the processor has them. */
#include "kernel/vec_avx2.h"

#include "kernel/kernel_simd.h"
#include "kernel/kernel_tiny.h"

bool cn_kernel_fill_avx2(cn_kernel *k)
{
    if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) return false;
    k->name = "avx2";
    simd_fill(k);
    simd_fill_tiny(k);
    return true;
}
