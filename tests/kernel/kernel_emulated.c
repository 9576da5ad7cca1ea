/* The vector source at the width of AVX-512, compiled for AVX2. */
#include "vec_emulated.h"

#include "kernel/kernel_simd.h"
#include "kernel/kernel_tiny.h"

#include "emulated.h"

bool emulated_fill(cn_kernel *k)
{
    if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) return false;
    k->name = "emulated";
    simd_fill(k);
    simd_fill_tiny(k);
    return true;
}
