/* Vectors of eight floats: AVX2 and FMA, or SIMDe's translation of them (NEON on ARM). One of the headers that
 * kernel_simd.h is compiled with. */
#ifndef CONURB_KERNEL_VEC_AVX2_H
#define CONURB_KERNEL_VEC_AVX2_H
#if defined(__x86_64__)
#include <immintrin.h>
#else
#define SIMDE_ENABLE_NATIVE_ALIASES
#include <simde/x86/avx2.h>
#include <simde/x86/fma.h>
#endif
#include <stdint.h>

#define V_LANES 8
#define V_GEMM_ROWS 4    /* by 3 vectors: 12 of 16 registers hold sums, and 12 FMAs take 7 loads */
#define V_GRAD_VECTORS 3 /* by 4 rows of a weight gradient */
#define GRAD_PANELS 4    /* panels transposed at a time; they fit the L1 cache */
#define V_MATCH_ROWS 4   /* by 2 vectors of products of descriptors: 8 of 16 registers hold sums */
#define V_MATCH_VECTORS 2

typedef __m256 vf;
typedef __m256i vi;
typedef __m256 vm; /* a mask: each lane has all bits set or none */

static inline vf v_load(const float *p)
{
    return _mm256_loadu_ps(p);
}
static inline void v_store(float *p, vf x)
{
    _mm256_storeu_ps(p, x);
}
static inline vf v_set(float x)
{
    return _mm256_set1_ps(x);
}
static inline vf v_add(vf a, vf b)
{
    return _mm256_add_ps(a, b);
}
static inline vf v_sub(vf a, vf b)
{
    return _mm256_sub_ps(a, b);
}
static inline vf v_mul(vf a, vf b)
{
    return _mm256_mul_ps(a, b);
}
static inline vf v_div(vf a, vf b)
{
    return _mm256_div_ps(a, b);
}
static inline vf v_fma(vf a, vf b, vf c)
{
    return _mm256_fmadd_ps(a, b, c);
}
static inline vf v_sqrt(vf x)
{
    return _mm256_sqrt_ps(x);
}
static inline vf v_floor(vf x)
{
    return _mm256_floor_ps(x);
}
/* For NaN the second operand is returned. */
static inline vf v_max(vf a, vf b)
{
    return _mm256_max_ps(a, b);
}
static inline vf v_min(vf a, vf b)
{
    return _mm256_min_ps(a, b);
}
static inline vf v_abs(vf x)
{
    return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), x);
}
static inline vi v_truncate(vf x)
{
    return _mm256_cvttps_epi32(x);
}
static inline vi v_bits(vf x)
{
    return _mm256_castps_si256(x);
}
static inline vf v_from_bits(vi x)
{
    return _mm256_castsi256_ps(x);
}

static inline vi vi_load(const uint32_t *p)
{
    return _mm256_loadu_si256((const __m256i *)(const void *)p);
}
static inline void vi_store(uint32_t *p, vi x)
{
    _mm256_storeu_si256((__m256i *)(void *)p, x);
}
static inline vi vi_set(uint32_t x)
{
    return _mm256_set1_epi32((int)x);
}
static inline vi vi_add(vi a, vi b)
{
    return _mm256_add_epi32(a, b);
}
static inline vi vi_sub(vi a, vi b)
{
    return _mm256_sub_epi32(a, b);
}
static inline vi vi_mul(vi a, vi b)
{
    return _mm256_mullo_epi32(a, b);
}
static inline vi vi_and(vi a, vi b)
{
    return _mm256_and_si256(a, b);
}
static inline vi vi_or(vi a, vi b)
{
    return _mm256_or_si256(a, b);
}
static inline vi vi_xor(vi a, vi b)
{
    return _mm256_xor_si256(a, b);
}
static inline vi vi_left(vi x, int n)
{
    return _mm256_slli_epi32(x, n);
}
static inline vi vi_right(vi x, int n)
{
    return _mm256_srli_epi32(x, n);
}
static inline vi vi_right_by(vi x, vi n)
{
    return _mm256_srlv_epi32(x, n);
}
static inline vf v_gather(const float *table, vi index)
{
    return _mm256_i32gather_ps(table, index, 4);
}
static inline vi vi_gather(const uint32_t *table, vi index)
{
    return _mm256_i32gather_epi32((const int *)table, index, 4);
}
/* table[index[lane]]. Single loads: on processors that split the gather instruction they take half as many operations.
 */
static inline __m128i vi_collect4(const uint32_t *table, const uint32_t *index)
{
    __m128i x = _mm_cvtsi32_si128((int)table[index[0]]);
    x = _mm_insert_epi32(x, (int)table[index[1]], 1);
    x = _mm_insert_epi32(x, (int)table[index[2]], 2);
    return _mm_insert_epi32(x, (int)table[index[3]], 3);
}
static inline vi vi_collect(const uint32_t *table, const uint32_t *index)
{
    return _mm256_inserti128_si256(_mm256_castsi128_si256(vi_collect4(table, index)), vi_collect4(table, index + 4), 1);
}
/* out[k]: table[index[lane] + k], two neighbours in one load. */
static inline __m128 vi_pairs2(const uint32_t *table, const uint32_t *index)
{
    const __m128 x = _mm_castsi128_ps(_mm_loadl_epi64((const __m128i *)(const void *)(table + index[0])));
    return _mm_loadh_pi(x, (const __m64 *)(const void *)(table + index[1]));
}
static inline void vi_collect_two(const uint32_t *table, const uint32_t *index, vi out[2])
{
    const __m256 a =
        _mm256_insertf128_ps(_mm256_castps128_ps256(vi_pairs2(table, index)), vi_pairs2(table, index + 4), 1);
    const __m256 b =
        _mm256_insertf128_ps(_mm256_castps128_ps256(vi_pairs2(table, index + 2)), vi_pairs2(table, index + 6), 1);
    out[0] = _mm256_castps_si256(_mm256_shuffle_ps(a, b, 0x88));
    out[1] = _mm256_castps_si256(_mm256_shuffle_ps(a, b, 0xdd));
}
/* Signed. */
static inline vi vi_max(vi a, vi b)
{
    return _mm256_max_epi32(a, b);
}
static inline vi vi_min(vi a, vi b)
{
    return _mm256_min_epi32(a, b);
}
/* The two signed 16-bit numbers of each lane, multiplied and added. */
static inline vi vi_multiply_pairs(vi a, vi b)
{
    return _mm256_madd_epi16(a, b);
}
static inline uint32_t vi_equal(vi a, vi b)
{
    return (uint32_t)_mm256_movemask_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(a, b)));
}
/* 16-bit words, zero-extended; and their low halves back. */
static inline vi vi_load16(const uint16_t *p)
{
    return _mm256_cvtepu16_epi32(_mm_loadu_si128((const __m128i *)(const void *)p));
}
static inline void vi_store16(uint16_t *p, vi x)
{
    const __m256i low = _mm256_and_si256(x, _mm256_set1_epi32(0xffff));
    const __m128i packed = _mm_packus_epi32(_mm256_castsi256_si128(low), _mm256_extracti128_si256(low, 1));
    _mm_storeu_si128((__m128i *)(void *)p, packed);
}

static inline vm v_positive(vf x)
{
    return _mm256_cmp_ps(x, _mm256_setzero_ps(), _CMP_GT_OQ);
}
static inline vm v_nonzero(vf x)
{
    return _mm256_cmp_ps(x, _mm256_setzero_ps(), _CMP_NEQ_UQ);
}
static inline vm v_less(vf a, vf b)
{
    return _mm256_cmp_ps(a, b, _CMP_LT_OQ);
}
static inline vm vi_greater(vi a, vi b)
{
    return _mm256_castsi256_ps(_mm256_cmpgt_epi32(a, b));
} /* signed */
static inline vm v_or(vm a, vm b)
{
    return _mm256_or_ps(a, b);
}
static inline uint32_t v_lanes(vm m)
{
    return (uint32_t)_mm256_movemask_ps(m);
} /* bit i: lane i */
static inline vf v_keep(vm m, vf x)
{
    return _mm256_and_ps(m, x);
}
static inline vf v_pick(vm m, vf yes, vf no)
{
    return _mm256_blendv_ps(no, yes, m);
}
static inline vi vi_pick(vm m, vi yes, vi no)
{
    return _mm256_castps_si256(_mm256_blendv_ps(_mm256_castsi256_ps(no), _mm256_castsi256_ps(yes), m));
}
#endif
