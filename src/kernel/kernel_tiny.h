/* Layers of tiny networks on vectors. This source is compiled once for each instruction set, after kernel_simd.h. A
 * sample's sums stay in registers, and the weights of an input are converted once for a block of samples. */

enum {
    TINY_PARTS = CN_TINY_PAIRS / V_LANES, /* vectors that hold the outputs of one half */
    TINY_BLOCK = V_LANES == 16 ? 8 : 2    /* samples whose sums fit the registers */
};
#define TINY_HIGH 0xffff0000u

V_INLINE void tiny_tile(const uint32_t n, cn_tiny_layer of, const float *x, bool relu, float *y)
{
    vf low[TINY_BLOCK][TINY_PARTS], high[TINY_BLOCK][TINY_PARTS];
    V_UNROLL for (uint32_t s = 0; s < n; s++) V_UNROLL for (int p = 0; p < TINY_PARTS; p++) low[s][p] = high[s][p] =
        v_set(0);
    for (uint32_t i = 0; i < of.k; i++)
        V_UNROLL for (int p = 0; p < TINY_PARTS; p++)
        {
            const vi pair = vi_load(of.w + (size_t)i * CN_TINY_PAIRS + p * V_LANES);
            const vf a = v_from_bits(vi_left(pair, 16)), b = v_from_bits(vi_and(pair, vi_set(TINY_HIGH)));
            V_UNROLL for (uint32_t s = 0; s < n; s++)
            {
                const vf by = v_set(x[s * CN_TINY + i]);
                low[s][p] = v_fma(by, a, low[s][p]);
                high[s][p] = v_fma(by, b, high[s][p]);
            }
        }
    V_UNROLL for (uint32_t s = 0; s < n; s++) V_UNROLL for (int p = 0; p < TINY_PARTS; p++)
    {
        float *to = y + s * CN_TINY + p * V_LANES;
        v_store(to, relu ? v_max(low[s][p], v_set(0)) : low[s][p]);
        v_store(to + CN_TINY_PAIRS, relu ? v_max(high[s][p], v_set(0)) : high[s][p]);
    }
}

static void simd_tiny(cn_tiny_layer of, const float *x, uint32_t n, bool relu, float *y)
{
    uint32_t s = 0;
    for (; s + TINY_BLOCK <= n; s += TINY_BLOCK)
        tiny_tile(TINY_BLOCK, of, x + (size_t)s * CN_TINY, relu, y + (size_t)s * CN_TINY);
    if (TINY_BLOCK > 4 && s + 4 <= n) {
        tiny_tile(4, of, x + (size_t)s * CN_TINY, relu, y + (size_t)s * CN_TINY);
        s += 4;
    }
    for (; s < n; s++)
        tiny_tile(1, of, x + (size_t)s * CN_TINY, relu, y + (size_t)s * CN_TINY);
}

/* Sum of eight floats. */
V_INLINE float tiny_sum8(__m256 x)
{
    __m128 sum = _mm_add_ps(_mm256_castps256_ps128(x), _mm256_extractf128_ps(x, 1));
    sum = _mm_add_ps(sum, _mm_movehl_ps(sum, sum));
    sum = _mm_add_ss(sum, _mm_shuffle_ps(sum, sum, 1));
    return _mm_cvtss_f32(sum);
}

static void simd_tiny_backward(cn_tiny_layer of, const float *dy, uint32_t n, const float *gate, float *dx)
{
    for (size_t s = 0; s < n; s++) {
        const float *d = dy + s * CN_TINY;
        vf low[TINY_PARTS], high[TINY_PARTS];
        V_UNROLL for (int p = 0; p < TINY_PARTS; p++)
        {
            low[p] = v_load(d + p * V_LANES);
            high[p] = v_load(d + CN_TINY_PAIRS + p * V_LANES);
        }
        for (size_t i = 0; i < of.k; i++) {
            vf sum = v_set(0);
            float lanes[V_LANES];
            V_UNROLL for (int p = 0; p < TINY_PARTS; p++)
            {
                const vi pair = vi_load(of.w + i * CN_TINY_PAIRS + p * V_LANES);
                sum = v_fma(v_from_bits(vi_left(pair, 16)), low[p], sum);
                sum = v_fma(v_from_bits(vi_and(pair, vi_set(TINY_HIGH))), high[p], sum);
            }
            v_store(lanes, sum);
            __m256 eight = _mm256_loadu_ps(lanes);
            if (V_LANES == 16) eight = _mm256_add_ps(eight, _mm256_loadu_ps(lanes + V_LANES - 8));
            dx[s * CN_TINY + i] = tiny_sum8(eight);
        }
        for (size_t i = 0; gate && i < of.k; i++)
            if (!(gate[s * CN_TINY + i] > 0)) dx[s * CN_TINY + i] = 0;
    }
}

/* The gradients of a block of samples, in the order of the parameters. */
static void simd_tiny_gradient(uint32_t k, const float *x, const float *dy, uint32_t n, float *grad)
{
    float d[TINY_BLOCK][CN_TINY];
    for (size_t s = 0; s < n; s += TINY_BLOCK) {
        const size_t block = n - s < TINY_BLOCK ? n - s : TINY_BLOCK;
        for (size_t b = 0; b < block; b++)
            for (size_t j = 0; j < CN_TINY_PAIRS; j++) {
                d[b][2 * j] = dy[(s + b) * CN_TINY + j];
                d[b][2 * j + 1] = dy[(s + b) * CN_TINY + CN_TINY_PAIRS + j];
            }
        for (size_t i = 0; i < k; i++) {
            float *to = grad + i * CN_TINY;
            vf sum[CN_TINY / V_LANES];
            V_UNROLL for (int p = 0; p < CN_TINY / V_LANES; p++) sum[p] = v_load(to + p * V_LANES);
            for (size_t b = 0; b < block; b++) {
                const vf by = v_set(x[(s + b) * CN_TINY + i]);
                V_UNROLL for (int p = 0; p < CN_TINY / V_LANES; p++) sum[p] =
                    v_fma(by, v_load(d[b] + p * V_LANES), sum[p]);
            }
            V_UNROLL for (int p = 0; p < CN_TINY / V_LANES; p++) v_store(to + p * V_LANES, sum[p]);
        }
    }
}

static void simd_fill_tiny(cn_kernel *k)
{
    k->tiny = simd_tiny;
    k->tiny_backward = simd_tiny_backward;
    k->tiny_gradient = simd_tiny_gradient;
}
