/* Vectors of sixteen floats: AVX-512 F, BW, DQ and VL. One of the headers that kernel_simd.h is compiled with. */
#ifndef CONURB_KERNEL_VEC_AVX512_H
#define CONURB_KERNEL_VEC_AVX512_H
#include <immintrin.h>
#include <stdint.h>

#define V_LANES 16
#define V_GEMM_ROWS 8    /* by 3 vectors: 24 of 32 registers hold sums */
#define V_GRAD_VECTORS 4 /* by 4 rows of a weight gradient */
#define GRAD_PANELS 2    /* panels transposed at a time; they fit the L1 cache */
#define V_MATCH_ROWS 8   /* by 3 vectors of products of descriptors */
#define V_MATCH_VECTORS 3

typedef __m512 vf;
typedef __m512i vi;
typedef __mmask16 vm;

static inline vf v_load(const float *p)
{
    return _mm512_loadu_ps(p);
}
static inline void v_store(float *p, vf x)
{
    _mm512_storeu_ps(p, x);
}
static inline vf v_set(float x)
{
    return _mm512_set1_ps(x);
}
static inline vf v_add(vf a, vf b)
{
    return _mm512_add_ps(a, b);
}
static inline vf v_sub(vf a, vf b)
{
    return _mm512_sub_ps(a, b);
}
static inline vf v_mul(vf a, vf b)
{
    return _mm512_mul_ps(a, b);
}
static inline vf v_div(vf a, vf b)
{
    return _mm512_div_ps(a, b);
}
static inline vf v_fma(vf a, vf b, vf c)
{
    return _mm512_fmadd_ps(a, b, c);
}
static inline vf v_sqrt(vf x)
{
    return _mm512_sqrt_ps(x);
}
static inline vf v_floor(vf x)
{
    return _mm512_roundscale_ps(x, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
}
/* For NaN the second operand is returned. */
static inline vf v_max(vf a, vf b)
{
    return _mm512_max_ps(a, b);
}
static inline vf v_min(vf a, vf b)
{
    return _mm512_min_ps(a, b);
}
static inline vf v_abs(vf x)
{
    return _mm512_abs_ps(x);
}
static inline vi v_truncate(vf x)
{
    return _mm512_cvttps_epi32(x);
}
static inline vi v_bits(vf x)
{
    return _mm512_castps_si512(x);
}
static inline vf v_from_bits(vi x)
{
    return _mm512_castsi512_ps(x);
}

static inline vi vi_load(const uint32_t *p)
{
    return _mm512_loadu_si512(p);
}
static inline void vi_store(uint32_t *p, vi x)
{
    _mm512_storeu_si512(p, x);
}
static inline vi vi_set(uint32_t x)
{
    return _mm512_set1_epi32((int)x);
}
static inline vi vi_add(vi a, vi b)
{
    return _mm512_add_epi32(a, b);
}
static inline vi vi_sub(vi a, vi b)
{
    return _mm512_sub_epi32(a, b);
}
static inline vi vi_mul(vi a, vi b)
{
    return _mm512_mullo_epi32(a, b);
}
static inline vi vi_and(vi a, vi b)
{
    return _mm512_and_si512(a, b);
}
static inline vi vi_or(vi a, vi b)
{
    return _mm512_or_si512(a, b);
}
static inline vi vi_xor(vi a, vi b)
{
    return _mm512_xor_si512(a, b);
}
static inline vi vi_left(vi x, int n)
{
    return _mm512_slli_epi32(x, (unsigned)n);
}
static inline vi vi_right(vi x, int n)
{
    return _mm512_srli_epi32(x, (unsigned)n);
}
static inline vi vi_right_by(vi x, vi n)
{
    return _mm512_srlv_epi32(x, n);
}
static inline vf v_gather(const float *table, vi index)
{
    return _mm512_i32gather_ps(index, table, 4);
}
static inline vi vi_gather(const uint32_t *table, vi index)
{
    return _mm512_i32gather_epi32(index, table, 4);
}
/* table[index[lane]]; and with the next entry of each lane. */
static inline vi vi_collect(const uint32_t *table, const uint32_t *index)
{
    return vi_gather(table, _mm512_loadu_si512(index));
}
static inline void vi_collect_two(const uint32_t *table, const uint32_t *index, vi out[2])
{
    out[0] = vi_collect(table, index);
    out[1] = vi_collect(table + 1, index);
}
/* Signed. */
static inline vi vi_max(vi a, vi b)
{
    return _mm512_max_epi32(a, b);
}
static inline vi vi_min(vi a, vi b)
{
    return _mm512_min_epi32(a, b);
}
/* The two signed 16-bit numbers of each lane, multiplied and added. */
static inline vi vi_multiply_pairs(vi a, vi b)
{
    return _mm512_madd_epi16(a, b);
}
static inline uint32_t vi_equal(vi a, vi b)
{
    return _mm512_cmpeq_epi32_mask(a, b);
}
/* 16-bit words, zero-extended; and their low halves back. */
static inline vi vi_load16(const uint16_t *p)
{
    return _mm512_cvtepu16_epi32(_mm256_loadu_si256((const __m256i *)(const void *)p));
}
static inline void vi_store16(uint16_t *p, vi x)
{
    _mm256_storeu_si256((__m256i *)(void *)p, _mm512_cvtepi32_epi16(x));
}

static inline vm v_positive(vf x)
{
    return _mm512_cmp_ps_mask(x, _mm512_setzero_ps(), _CMP_GT_OQ);
}
static inline vm v_nonzero(vf x)
{
    return _mm512_cmp_ps_mask(x, _mm512_setzero_ps(), _CMP_NEQ_UQ);
}
static inline vm v_less(vf a, vf b)
{
    return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ);
}
static inline vm vi_greater(vi a, vi b)
{
    return _mm512_cmpgt_epi32_mask(a, b);
} /* signed */
static inline vm v_or(vm a, vm b)
{
    return (vm)(a | b);
}
static inline uint32_t v_lanes(vm m)
{
    return m;
} /* bit i: lane i */
static inline vf v_keep(vm m, vf x)
{
    return _mm512_maskz_mov_ps(m, x);
}
static inline vf v_pick(vm m, vf yes, vf no)
{
    return _mm512_mask_blend_ps(m, no, yes);
}
static inline vi vi_pick(vm m, vi yes, vi no)
{
    return _mm512_mask_blend_epi32(m, no, yes);
}
#endif
