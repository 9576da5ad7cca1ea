/* AVX-512 F, BW, DQ, VL. Compiled with these flags; called only when the processor has them. */
#include "kernel/vec_avx512.h"

#include "kernel/kernel_simd.h"
#include "kernel/kernel_tiny.h"

bool cn_kernel_fill_avx512(cn_kernel *k)
{
    if (!__builtin_cpu_supports("avx512f") || !__builtin_cpu_supports("avx512bw") ||
        !__builtin_cpu_supports("avx512dq") || !__builtin_cpu_supports("avx512vl"))
        return false;
    k->name = "avx512";
    simd_fill(k);
    simd_fill_tiny(k);
    cn_kernel_use_vnni(k);
    return true;
}
