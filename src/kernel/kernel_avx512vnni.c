/* AVX-512 VNNI: products of bytes, for sets that already have AVX-512. Overrides only `match`, whose result is exact.
 */
#include "kernel/vec_avx512.h"

#define V_INLINE static inline __attribute__((always_inline))
#define V_UNROLL _Pragma("GCC unroll 32")
#define MATCH_BYTES
#include "kernel/kernel_match.h"

void cn_kernel_use_vnni(cn_kernel *k)
{
    if (__builtin_cpu_supports("avx512vnni")) k->match = simd_match;
}
