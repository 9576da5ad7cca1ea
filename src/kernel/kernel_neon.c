/* NEON, from the source of the AVX2 set through SIMDe. Every 64-bit ARM processor has it. */
#include "kernel/vec_avx2.h"

#include "kernel/kernel_simd.h"

bool cn_kernel_fill_neon(cn_kernel *k)
{
    k->name = "neon";
    simd_fill(k);
    return true;
}
