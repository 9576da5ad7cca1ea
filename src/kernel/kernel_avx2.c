/* AVX2 + FMA. Compiled with -mavx2 -mfma; called only after cn_kernel_best has asked the processor. */
#include "kernel/kernel.h"

#include <immintrin.h>
#include <math.h>

/* Four rows by 24 lanes: 12 accumulators, 4 broadcasts and 3 loads for 12 FMAs, so the FMA ports bind, not the loads. */
static inline void gemm_tile(const float *a, uint32_t m, uint32_t k, const float *x, float *y, const float *gate, bool relu)
{
    __m256 c[4][3];
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 3; j++) c[i][j] = _mm256_setzero_ps();
    for (uint32_t r = 0; r < k; r++) {
        const __m256 x0 = _mm256_loadu_ps(x), x1 = _mm256_loadu_ps(x + 8), x2 = _mm256_loadu_ps(x + 16);
        for (int i = 0; i < 4; i++) {
            const __m256 w = _mm256_broadcast_ss(a + i);
            c[i][0] = _mm256_fmadd_ps(w, x0, c[i][0]);
            c[i][1] = _mm256_fmadd_ps(w, x1, c[i][1]);
            c[i][2] = _mm256_fmadd_ps(w, x2, c[i][2]);
        }
        a += m;
        x += CN_PANEL;
    }
    const __m256 zero = _mm256_setzero_ps();
    for (int i = 0; i < 4; i++) {
        for (int j = 0; j < 3; j++) {
            __m256 r = c[i][j];
            if (relu) r = _mm256_max_ps(r, zero);
            if (gate) r = _mm256_and_ps(r, _mm256_cmp_ps(_mm256_loadu_ps(gate + i * CN_PANEL + j * 8), zero, _CMP_GT_OQ));
            _mm256_storeu_ps(y + i * CN_PANEL + j * 8, r);
        }
    }
}

static void avx2_gemm(const float *a, uint32_t m, uint32_t k, const float *x, float *y, const float *gate, bool relu)
{
    for (uint32_t half = 0; half < CN_PANEL; half += 24)
        for (uint32_t i = 0; i < m; i += 4)
            gemm_tile(a + i, m, k, x + half, y + (size_t)i * CN_PANEL + half, gate ? gate + (size_t)i * CN_PANEL + half : NULL,
                      relu);
}

/* Sums of the lanes of eight vectors, in order. */
static inline __m256 sum8(const __m256 v[8])
{
    const __m256 a = _mm256_hadd_ps(_mm256_hadd_ps(v[0], v[1]), _mm256_hadd_ps(v[2], v[3]));
    const __m256 b = _mm256_hadd_ps(_mm256_hadd_ps(v[4], v[5]), _mm256_hadd_ps(v[6], v[7]));
    return _mm256_add_ps(_mm256_permute2f128_ps(a, b, 0x20), _mm256_permute2f128_ps(a, b, 0x31));
}

static void avx2_weight_grad(const float *dy, size_t dy_stride, const float *x, size_t x_stride, uint32_t m, uint32_t k,
                             size_t n_panels, float *dw)
{
    for (uint32_t i = 0; i < m; i += 4) {
        for (uint32_t j = 0; j < k; j += 2) {
            __m256 c[8];
            for (int q = 0; q < 8; q++) c[q] = _mm256_setzero_ps();
            for (size_t p = 0; p < n_panels; p++) {
                const float *a = dy + p * dy_stride + (size_t)i * CN_PANEL;
                const float *b = x + p * x_stride + (size_t)j * CN_PANEL;
                for (uint32_t lane = 0; lane < CN_PANEL; lane += 8) {
                    const __m256 b0 = _mm256_loadu_ps(b + lane), b1 = _mm256_loadu_ps(b + CN_PANEL + lane);
                    for (int r = 0; r < 4; r++) {
                        const __m256 w = _mm256_loadu_ps(a + (size_t)r * CN_PANEL + lane);
                        c[2 * r] = _mm256_fmadd_ps(w, b0, c[2 * r]);
                        c[2 * r + 1] = _mm256_fmadd_ps(w, b1, c[2 * r + 1]);
                    }
                }
            }
            float sums[8];
            _mm256_storeu_ps(sums, sum8(c));
            for (int r = 0; r < 4; r++) {
                dw[(size_t)(i + r) * k + j] += sums[2 * r];
                dw[(size_t)(i + r) * k + j + 1] += sums[2 * r + 1];
            }
        }
    }
}

typedef struct corner8 {
    __m256i low[3], high[3]; /* index contribution of the lower and upper vertex along an axis */
    __m256 f[3], g[3];       /* fraction and 1 - fraction */
} corner8;

static inline corner8 corners8(const cn_level *level, const float *pos)
{
    static const uint32_t prime[3] = {1u, 2654435761u, 805459861u};
    corner8 c;
    const __m256 resolution = _mm256_set1_ps((float)level->resolution), one = _mm256_set1_ps(1);
    uint32_t stride = 1;
    for (int a = 0; a < 3; a++) {
        /* max before min: max_ps returns its second operand for NaN, which pulls NaN to 0. */
        __m256 x = _mm256_min_ps(_mm256_max_ps(_mm256_loadu_ps(pos + a * CN_PANEL), _mm256_setzero_ps()), one);
        x = _mm256_add_ps(_mm256_mul_ps(x, resolution), _mm256_set1_ps(0.5f));
        const __m256 cell = _mm256_floor_ps(x);
        c.f[a] = _mm256_sub_ps(x, cell);
        c.g[a] = _mm256_sub_ps(one, c.f[a]);
        const uint32_t factor = level->hashed ? prime[a] : stride;
        c.low[a] = _mm256_mullo_epi32(_mm256_cvttps_epi32(cell), _mm256_set1_epi32((int)factor));
        c.high[a] = _mm256_add_epi32(c.low[a], _mm256_set1_epi32((int)factor));
        stride *= level->resolution + 2;
    }
    return c;
}

static inline __m256i corner_index(const cn_level *level, const corner8 *c, int i)
{
    const __m256i x = (i & 1) ? c->high[0] : c->low[0];
    const __m256i y = (i & 2) ? c->high[1] : c->low[1];
    const __m256i z = (i & 4) ? c->high[2] : c->low[2];
    if (!level->hashed) return _mm256_add_epi32(_mm256_add_epi32(x, y), z);
    return _mm256_and_si256(_mm256_xor_si256(_mm256_xor_si256(x, y), z), _mm256_set1_epi32((int)(level->entries - 1)));
}

static inline __m256 corner_weight(const corner8 *c, int i)
{
    return _mm256_mul_ps(_mm256_mul_ps((i & 1) ? c->f[0] : c->g[0], (i & 2) ? c->f[1] : c->g[1]), (i & 4) ? c->f[2] : c->g[2]);
}

static void avx2_encode(const cn_level *level, const uint32_t *table, const float *pos, size_t n_panels, float *out,
                        size_t out_stride)
{
    const __m256i high = _mm256_set1_epi32((int)0xffff0000u);
    for (size_t p = 0; p < n_panels; p++) {
        for (uint32_t lane = 0; lane < CN_PANEL; lane += 8) {
            const corner8 c = corners8(level, pos + p * 3 * CN_PANEL + lane);
            __m256 sum0 = _mm256_setzero_ps(), sum1 = _mm256_setzero_ps();
            for (int i = 0; i < 8; i++) {
                const __m256i pair = _mm256_i32gather_epi32((const int *)table, corner_index(level, &c, i), 4);
                const __m256 w = corner_weight(&c, i);
                sum0 = _mm256_fmadd_ps(w, _mm256_castsi256_ps(_mm256_slli_epi32(pair, 16)), sum0);
                sum1 = _mm256_fmadd_ps(w, _mm256_castsi256_ps(_mm256_and_si256(pair, high)), sum1);
            }
            _mm256_storeu_ps(out + p * out_stride + lane, sum0);
            _mm256_storeu_ps(out + p * out_stride + CN_PANEL + lane, sum1);
        }
    }
}

static void avx2_encode_backward(const cn_level *level, const float *pos, const float *dout, size_t dout_stride,
                                 size_t n_panels, float *grad)
{
    _Alignas(32) uint32_t index[8][8];
    _Alignas(32) float weight[8][8], g0[8], g1[8];
    for (size_t p = 0; p < n_panels; p++) {
        for (uint32_t lane = 0; lane < CN_PANEL; lane += 8) {
            const __m256 d0 = _mm256_loadu_ps(dout + p * dout_stride + lane);
            const __m256 d1 = _mm256_loadu_ps(dout + p * dout_stride + CN_PANEL + lane);
            int live = _mm256_movemask_ps(_mm256_or_ps(_mm256_cmp_ps(d0, _mm256_setzero_ps(), _CMP_NEQ_UQ),
                                                       _mm256_cmp_ps(d1, _mm256_setzero_ps(), _CMP_NEQ_UQ)));
            if (!live) continue;
            const corner8 c = corners8(level, pos + p * 3 * CN_PANEL + lane);
            for (int i = 0; i < 8; i++) {
                _mm256_store_si256((__m256i *)index[i], corner_index(level, &c, i));
                _mm256_store_ps(weight[i], corner_weight(&c, i));
            }
            _mm256_store_ps(g0, d0);
            _mm256_store_ps(g1, d1);
            for (; live; live &= live - 1) {
                const int s = __builtin_ctz((unsigned)live);
                const __m128 g = _mm_setr_ps(g0[s], g1[s], 0, 0);
                for (int i = 0; i < 8; i++) {
                    float *at = grad + 2 * (size_t)index[i][s];
                    const __m128 old = _mm_castpd_ps(_mm_load_sd((const double *)(const void *)at));
                    _mm_store_sd((double *)(void *)at, _mm_castps_pd(_mm_fmadd_ps(g, _mm_set1_ps(weight[i][s]), old)));
                }
            }
        }
    }
}

/* Contraction of eight points; u in [0,1], returns the local scale. */
static inline __m256 contract8(const __m256 x[3], __m256 u[3])
{
    const __m256 sign = _mm256_set1_ps(-0.0f), one = _mm256_set1_ps(1);
    const __m256 m = _mm256_max_ps(_mm256_andnot_ps(sign, x[0]),
                                   _mm256_max_ps(_mm256_andnot_ps(sign, x[1]), _mm256_andnot_ps(sign, x[2])));
    const __m256 inv = _mm256_div_ps(one, _mm256_max_ps(m, one));
    const __m256 s = _mm256_mul_ps(_mm256_sub_ps(_mm256_set1_ps(2), inv), inv);
    for (int a = 0; a < 3; a++)
        u[a] = _mm256_fmadd_ps(_mm256_mul_ps(x[a], s), _mm256_set1_ps(0.25f), _mm256_set1_ps(0.5f));
    return s;
}

static inline __m256i occ_axis(__m256 u)
{
    const __m256 c = _mm256_mul_ps(u, _mm256_set1_ps(CN_OCC_RES));
    return _mm256_cvttps_epi32(_mm256_min_ps(_mm256_max_ps(c, _mm256_setzero_ps()), _mm256_set1_ps(CN_OCC_RES - 1)));
}

static uint32_t avx2_march(const cn_kray *ray, const cn_march *march, const uint32_t *occ, float *t, uint32_t max)
{
    float power[8], first = march->near_t * powf(march->ratio, march->jitter);
    power[0] = 1;
    for (int i = 1; i < 8; i++) power[i] = power[i - 1] * march->ratio;
    const __m256 powers = _mm256_loadu_ps(power);
    const float ratio8 = power[7] * march->ratio;
    uint32_t n = 0;
    for (float at = first; at < march->far_t && n < max; at *= ratio8) {
        const __m256 tv = _mm256_mul_ps(_mm256_set1_ps(at), powers);
        __m256 x[3], u[3];
        for (int a = 0; a < 3; a++)
            x[a] = _mm256_fmadd_ps(tv, _mm256_set1_ps(ray->dir[a]), _mm256_set1_ps(ray->origin[a]));
        contract8(x, u);
        const __m256i bit =
            _mm256_add_epi32(occ_axis(u[0]), _mm256_slli_epi32(_mm256_add_epi32(occ_axis(u[1]),
                                                                              _mm256_slli_epi32(occ_axis(u[2]), 7)), 7));
        const __m256i word = _mm256_i32gather_epi32((const int *)occ, _mm256_srli_epi32(bit, 5), 4);
        /* The cell's bit goes to the sign; the shift counts left by 31 - (bit & 31). */
        const __m256i shift = _mm256_xor_si256(_mm256_and_si256(bit, _mm256_set1_epi32(31)), _mm256_set1_epi32(31));
        const __m256 set = _mm256_castsi256_ps(_mm256_sllv_epi32(word, shift));
        int live = _mm256_movemask_ps(_mm256_and_ps(set, _mm256_cmp_ps(tv, _mm256_set1_ps(march->far_t), _CMP_LT_OQ)));
        float lanes[8];
        _mm256_storeu_ps(lanes, tv);
        for (; live && n < max; live &= live - 1) t[n++] = lanes[__builtin_ctz((unsigned)live)];
    }
    return n;
}

static void avx2_place(const cn_kray *ray, const float *t, uint32_t n, float step, float inv_extent, size_t first, float *pos,
                       float *length)
{
    const __m256 factor = _mm256_set1_ps(step * inv_extent);
    for (uint32_t i = 0; i < n; i += 8) {
        const uint32_t count = n - i < 8 ? n - i : 8;
        float tail[8] = {0}, lanes[3][8], lengths[8];
        for (uint32_t q = 0; q < count; q++) tail[q] = t[i + q];
        const __m256 tv = _mm256_loadu_ps(tail);
        __m256 x[3], u[3];
        for (int a = 0; a < 3; a++)
            x[a] = _mm256_fmadd_ps(tv, _mm256_set1_ps(ray->dir[a]), _mm256_set1_ps(ray->origin[a]));
        const __m256 s = contract8(x, u);
        for (int a = 0; a < 3; a++) _mm256_storeu_ps(lanes[a], u[a]);
        _mm256_storeu_ps(lengths, _mm256_mul_ps(_mm256_mul_ps(tv, factor), s));
        for (uint32_t q = 0; q < count; q++) {
            const size_t at = first + i + q;
            float *lane = pos + at / CN_PANEL * (3 * CN_PANEL) + at % CN_PANEL;
            for (int a = 0; a < 3; a++) lane[a * CN_PANEL] = lanes[a][q];
            length[i + q] = lengths[q];
        }
    }
}

static void avx2_adam(const cn_adam *adam, float *p, float *m, float *v, float *g, uint16_t *copy, size_t n, bool sparse)
{
    const __m256 zero = _mm256_setzero_ps(), b1 = _mm256_set1_ps(adam->beta1), b2 = _mm256_set1_ps(adam->beta2);
    const __m256 c1 = _mm256_set1_ps(1 - adam->beta1), c2 = _mm256_set1_ps(1 - adam->beta2);
    const __m256 rate = _mm256_set1_ps(adam->rate), eps = _mm256_set1_ps(adam->epsilon), decay = _mm256_set1_ps(adam->decay);
    for (size_t i = 0; i < n; i += 8) {
        const __m256 raw = _mm256_loadu_ps(g + i);
        const __m256 none = _mm256_cmp_ps(raw, zero, _CMP_EQ_OQ); /* lanes to leave alone when sparse */
        if (sparse && _mm256_movemask_ps(none) == 0xff) continue;
        const __m256 p0 = _mm256_loadu_ps(p + i), m0 = _mm256_loadu_ps(m + i), v0 = _mm256_loadu_ps(v + i);
        const __m256 grad = _mm256_fmadd_ps(decay, p0, raw);
        __m256 m1 = _mm256_fmadd_ps(b1, m0, _mm256_mul_ps(c1, grad));
        __m256 v1 = _mm256_fmadd_ps(b2, v0, _mm256_mul_ps(c2, _mm256_mul_ps(grad, grad)));
        __m256 p1 = _mm256_sub_ps(p0, _mm256_div_ps(_mm256_mul_ps(rate, m1), _mm256_add_ps(_mm256_sqrt_ps(v1), eps)));
        if (sparse) {
            m1 = _mm256_blendv_ps(m1, m0, none);
            v1 = _mm256_blendv_ps(v1, v0, none);
            p1 = _mm256_blendv_ps(p1, p0, none);
        }
        _mm256_storeu_ps(p + i, p1);
        _mm256_storeu_ps(m + i, m1);
        _mm256_storeu_ps(v + i, v1);
        _mm256_storeu_ps(g + i, zero);
        if (copy) {
            __m256i bits = _mm256_castps_si256(p1);
            const __m256i odd = _mm256_and_si256(_mm256_srli_epi32(bits, 16), _mm256_set1_epi32(1));
            bits = _mm256_srli_epi32(_mm256_add_epi32(bits, _mm256_add_epi32(odd, _mm256_set1_epi32(0x7fff))), 16);
            const __m128i packed = _mm_packus_epi32(_mm256_castsi256_si128(bits), _mm256_extracti128_si256(bits, 1));
            _mm_storeu_si128((__m128i *)(void *)(copy + i), packed);
        }
    }
}

bool cn_kernel_fill_avx2(cn_kernel *k)
{
    if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) return false;
    k->name = "avx2";
    k->gemm = avx2_gemm;
    k->weight_grad = avx2_weight_grad;
    k->encode = avx2_encode;
    k->encode_backward = avx2_encode_backward;
    k->march = avx2_march;
    k->place = avx2_place;
    k->adam = avx2_adam;
    return true;
}
