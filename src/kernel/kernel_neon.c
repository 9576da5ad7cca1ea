/* NEON: the source of the AVX2 set, compiled through SIMDe. Every 64-bit ARM processor has NEON. */
#include "kernel/vec_avx2.h"

#include "kernel/kernel_simd.h"
#include "kernel/kernel_tiny.h"

bool cn_kernel_fill_neon(cn_kernel *k)
{
    k->name = "neon";
    simd_fill(k);
    simd_fill_tiny(k);
    return true;
}
