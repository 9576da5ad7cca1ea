/* AVX-512 with bf16 dot products: products of bf16 pairs, sums in float. Overrides the gemm of the avx512 set: inputs
 * and weights are rounded as they are read (relative error 2^-8 per factor). No other code depends on it. */
#include "kernel/kernel.h"

#include <immintrin.h>

enum { VECTORS = CN_PANEL / 16, ROWS = 8, MAX_K = 512 };
#define V_UNROLL _Pragma("GCC unroll 32")

/* Rows 2r and 2r + 1 as pairs of bf16: the even row in the low half. */
static inline __m512i pair(__m512 even, __m512 odd)
{
    const __m512i low = _mm512_cvtepu16_epi32((__m256i)_mm512_cvtneps_pbh(even));
    const __m512i high = _mm512_cvtepu16_epi32((__m256i)_mm512_cvtneps_pbh(odd));
    return _mm512_or_si512(low, _mm512_slli_epi32(high, 16));
}

static inline void tile(const uint32_t *a, uint32_t pairs, const __m512i *x, float *y, const float *gate, bool relu)
{
    __m512 c[ROWS][VECTORS];
    V_UNROLL for (int i = 0; i < ROWS; i++) V_UNROLL for (int j = 0; j < VECTORS; j++) c[i][j] = _mm512_setzero_ps();
    for (uint32_t r = 0; r < pairs; r++, a += ROWS, x += VECTORS) {
        V_UNROLL for (int i = 0; i < ROWS; i++)
        {
            const __m512bh w = (__m512bh)_mm512_set1_epi32((int)a[i]);
            V_UNROLL for (int j = 0; j < VECTORS; j++) c[i][j] = _mm512_dpbf16_ps(c[i][j], w, (__m512bh)x[j]);
        }
    }
    V_UNROLL for (int i = 0; i < ROWS; i++)
    {
        V_UNROLL for (int j = 0; j < VECTORS; j++)
        {
            __m512 sum = c[i][j];
            if (relu) sum = _mm512_max_ps(sum, _mm512_setzero_ps());
            if (gate) {
                const __m512 g = _mm512_loadu_ps(gate + i * CN_PANEL + j * 16);
                sum = _mm512_maskz_mov_ps(_mm512_cmp_ps_mask(g, _mm512_setzero_ps(), _CMP_GT_OQ), sum);
            }
            _mm512_storeu_ps(y + i * CN_PANEL + j * 16, sum);
        }
    }
}

static cn_kernel plain; /* for shapes that do not split into pairs */

static void bf16_gemm(cn_matrix a, const float *x, float *y, const float *gate, bool relu)
{
    const uint32_t m = a.m, k = a.k;
    if (m % 16 || k % 2 || k > MAX_K || m > 256) {
        plain.gemm(a, x, y, gate, relu);
        return;
    }
    __m512i xs[MAX_K / 2 * VECTORS];
    uint32_t w[MAX_K / 2 * ROWS];
    const uint32_t pairs = k / 2;
    for (uint32_t r = 0; r < pairs; r++)
        for (uint32_t j = 0; j < VECTORS; j++) {
            const float *row = x + (size_t)2 * r * CN_PANEL + j * 16;
            xs[r * VECTORS + j] = pair(_mm512_loadu_ps(row), _mm512_loadu_ps(row + CN_PANEL));
        }
    for (uint32_t i = 0; i < m; i += ROWS) {
        for (uint32_t r = 0; r < pairs; r++) {
            const float *even = a.a + (size_t)2 * r * m + i;
            const __m512 low = _mm512_zextps256_ps512(_mm256_loadu_ps(even)),
                         high = _mm512_zextps256_ps512(_mm256_loadu_ps(even + m));
            _mm256_storeu_si256((__m256i *)(void *)(w + r * ROWS), _mm512_castsi512_si256(pair(low, high)));
        }
        const size_t at = (size_t)i * CN_PANEL;
        tile(w, pairs, xs, y + at, gate ? gate + at : NULL, relu);
    }
}

bool cn_kernel_fill_avx512bf16(cn_kernel *k)
{
    if (!__builtin_cpu_supports("avx512bf16") || !cn_kernel_fill_avx512(k)) return false;
    plain = *k;
    k->name = "avx512bf16";
    k->gemm = bf16_gemm;
    return true;
}
