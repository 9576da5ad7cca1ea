/* The kernels on vectors. This source is compiled once for each instruction set, after a header that defines the
 * vector type (vec_avx2.h, vec_avx512.h). Everything is static, because each object has the same names. */
#include "kernel/kernel.h"

#include <math.h>

#define V_INLINE static inline __attribute__((always_inline))
#define V_UNROLL _Pragma("GCC unroll 32") /* unroll before registers are allocated */
_Static_assert(CN_PANEL % (3 * V_LANES) == 0, "a panel is a whole number of gemm tiles");

/* ---- gemm: rows x 3 vectors of sums in registers ---- */

V_INLINE void gemm_tile(const int rows, cn_matrix of, const float *x, float *y, const float *gate, bool relu)
{
    const float *a = of.a;
    vf c[V_GEMM_ROWS][3];
    V_UNROLL for (int i = 0; i < rows; i++) V_UNROLL for (int j = 0; j < 3; j++) c[i][j] = v_set(0);
    for (uint32_t r = 0; r < of.k; r++) {
        const vf x0 = v_load(x), x1 = v_load(x + V_LANES), x2 = v_load(x + 2 * V_LANES);
        V_UNROLL for (int i = 0; i < rows; i++)
        {
            const vf w = v_set(a[i]);
            c[i][0] = v_fma(w, x0, c[i][0]);
            c[i][1] = v_fma(w, x1, c[i][1]);
            c[i][2] = v_fma(w, x2, c[i][2]);
        }
        a += of.m;
        x += CN_PANEL;
    }
    V_UNROLL for (int i = 0; i < rows; i++)
    {
        V_UNROLL for (int j = 0; j < 3; j++)
        {
            vf sum = c[i][j];
            if (relu) sum = v_max(sum, v_set(0));
            if (gate) sum = v_keep(v_positive(v_load(gate + i * CN_PANEL + j * V_LANES)), sum);
            v_store(y + i * CN_PANEL + j * V_LANES, sum);
        }
    }
}

static void simd_gemm(cn_matrix a, const float *x, float *y, const float *gate, bool relu)
{
    uint32_t i = 0;
    for (; i + V_GEMM_ROWS <= a.m; i += V_GEMM_ROWS)
        for (uint32_t lane = 0; lane < CN_PANEL; lane += 3 * V_LANES) {
            const size_t at = (size_t)i * CN_PANEL + lane;
            gemm_tile(V_GEMM_ROWS, (cn_matrix){ a.a + i, a.m, a.k }, x + lane, y + at, gate ? gate + at : NULL, relu);
        }
    for (; i < a.m; i += 4)
        for (uint32_t lane = 0; lane < CN_PANEL; lane += 3 * V_LANES) {
            const size_t at = (size_t)i * CN_PANEL + lane;
            gemm_tile(4, (cn_matrix){ a.a + i, a.m, a.k }, x + lane, y + at, gate ? gate + at : NULL, relu);
        }
}

/* ---- weight gradient ---- An outer product: x is transposed to [lane][column], so that sums run over lanes and no
 * horizontal sum is needed. */

enum { GRAD_LANES = GRAD_PANELS * CN_PANEL, GRAD_WIDTH = V_GRAD_VECTORS * V_LANES };

/* Eight rows of eight floats to eight columns. */
V_INLINE void turn8(const float *x, size_t x_row, float *out, size_t out_row)
{
    __m256 r[8], s[8];
    V_UNROLL for (int i = 0; i < 8; i++) r[i] = _mm256_loadu_ps(x + (size_t)i * x_row);
    V_UNROLL for (int i = 0; i < 8; i += 2)
    {
        s[i] = _mm256_unpacklo_ps(r[i], r[i + 1]);
        s[i + 1] = _mm256_unpackhi_ps(r[i], r[i + 1]);
    }
    V_UNROLL for (int i = 0; i < 8; i += 4)
    {
        r[i] = _mm256_shuffle_ps(s[i], s[i + 2], 0x44);
        r[i + 1] = _mm256_shuffle_ps(s[i], s[i + 2], 0xee);
        r[i + 2] = _mm256_shuffle_ps(s[i + 1], s[i + 3], 0x44);
        r[i + 3] = _mm256_shuffle_ps(s[i + 1], s[i + 3], 0xee);
    }
    V_UNROLL for (int i = 0; i < 4; i++)
    {
        _mm256_storeu_ps(out + (size_t)i * out_row, _mm256_permute2f128_ps(r[i], r[i + 4], 0x20));
        _mm256_storeu_ps(out + (size_t)(i + 4) * out_row, _mm256_permute2f128_ps(r[i], r[i + 4], 0x31));
    }
}

/* Columns of x past `columns` are 0. */
static void turn_panels(const float *x, size_t x_stride, uint32_t columns, size_t n_panels, float *turned)
{
    for (size_t p = 0; p < n_panels; p++, x += x_stride)
        for (uint32_t lane = 0; lane < CN_PANEL; lane += 8, turned += 8 * GRAD_WIDTH) {
            uint32_t c = 0;
            for (; c + 8 <= columns; c += 8)
                turn8(x + (size_t)c * CN_PANEL + lane, CN_PANEL, turned + c, GRAD_WIDTH);
            for (; c % V_LANES || c < columns; c++)
                for (uint32_t i = 0; i < 8; i++)
                    turned[i * GRAD_WIDTH + c] = c < columns ? x[(size_t)c * CN_PANEL + lane + i] : 0;
        }
}

/* Four rows of a block of columns of dw[][k]. */
typedef struct grad_block {
    float *dw;
    uint32_t k, columns;
} grad_block;

V_INLINE void grad_tile(const int vectors, const float *dy, size_t dy_stride, const float *turned, size_t n_panels,
                        grad_block to)
{
    vf c[4][V_GRAD_VECTORS];
    V_UNROLL for (int r = 0; r < 4; r++) V_UNROLL for (int q = 0; q < vectors; q++) c[r][q] = v_set(0);
    for (size_t p = 0; p < n_panels; p++, dy += dy_stride)
        for (uint32_t lane = 0; lane < CN_PANEL; lane++, turned += GRAD_WIDTH)
            V_UNROLL for (int r = 0; r < 4; r++)
            {
                const vf w = v_set(dy[r * CN_PANEL + lane]);
                V_UNROLL for (int q = 0; q < vectors; q++) c[r][q] = v_fma(w, v_load(turned + q * V_LANES), c[r][q]);
            }
    float sums[4][GRAD_WIDTH];
    V_UNROLL for (int r = 0; r < 4; r++)
    {
        float *row = to.dw + (size_t)r * to.k;
        if (to.columns == (uint32_t)vectors * V_LANES) {
            V_UNROLL for (int q = 0; q < vectors; q++)
                v_store(row + q * V_LANES, v_add(v_load(row + q * V_LANES), c[r][q]));
            continue;
        }
        V_UNROLL for (int q = 0; q < vectors; q++) v_store(sums[r] + q * V_LANES, c[r][q]);
        for (uint32_t q = 0; q < to.columns; q++)
            row[q] += sums[r][q];
    }
}

/* The width of a block of columns: as many vectors as registers allow, but 2 + 2 rather than 3 + 1. */
static uint32_t grad_columns(uint32_t left)
{
    if (left <= GRAD_WIDTH) return left;
    return left <= GRAD_WIDTH + V_LANES ? GRAD_WIDTH - V_LANES : GRAD_WIDTH;
}

static void simd_weight_grad(const cn_panel_rows *dy, const cn_panel_rows *x, size_t n_panels, float *dw)
{
    const uint32_t m = dy->n, k = x->n;
    _Alignas(64) float turned[GRAD_LANES * GRAD_WIDTH];
    for (size_t first = 0; first < n_panels; first += GRAD_PANELS) {
        const size_t n = n_panels - first < GRAD_PANELS ? n_panels - first : GRAD_PANELS;
        for (uint32_t j = 0, columns; j < k; j += columns) {
            columns = grad_columns(k - j);
            turn_panels(x->data + first * x->stride + (size_t)j * CN_PANEL, x->stride, columns, n, turned);
            for (uint32_t i = 0; i < m; i += 4) {
                const float *rows = dy->data + first * dy->stride + (size_t)i * CN_PANEL;
                const grad_block at = { dw + (size_t)i * k + j, k, columns };
                switch ((columns + V_LANES - 1) / V_LANES) {
                case 1: grad_tile(1, rows, dy->stride, turned, n, at); break;
                case 2: grad_tile(2, rows, dy->stride, turned, n, at); break;
                case 3: grad_tile(3, rows, dy->stride, turned, n, at); break;
#if V_GRAD_VECTORS > 3
                default: grad_tile(4, rows, dy->stride, turned, n, at); break;
#endif
                }
            }
        }
    }
}

/* ---- hash grid ---- */

typedef struct corners {
    vi cell[3];         /* the lower vertex */
    vi low[3], high[3]; /* index contribution of the lower and upper vertex along an axis */
    vf f[3], g[3];      /* fraction and 1 - fraction */
} corners;

/* As cn_hash_x, _y and _z. */
V_INLINE vi hash_axis(int axis, vi x)
{
    static const uint32_t prime[3] = { 0, 2654435761u, 805459861u };
    if (axis == 0)
        return vi_or(vi_left(vi_right(x, 2), 4), vi_or(vi_and(x, vi_set(1)), vi_left(vi_and(x, vi_set(2)), 2)));
    return vi_or(vi_left(vi_mul(vi_right(x, 1), vi_set(prime[axis])), 4), vi_left(vi_and(x, vi_set(1)), axis));
}

V_INLINE corners corners_of(const cn_level *level, const float *pos)
{
    corners c;
    const vf resolution = v_set((float)level->resolution), one = v_set(1);
    uint32_t stride = 1;
    V_UNROLL for (int a = 0; a < 3; a++)
    {
        /* max before min: max returns its second operand for NaN, so NaN becomes 0. */
        vf x = v_min(v_max(v_load(pos + a * CN_PANEL), v_set(0)), one);
        x = v_add(v_mul(x, resolution), v_set(0.5f));
        const vf cell = v_floor(x);
        c.f[a] = v_sub(x, cell);
        c.g[a] = v_sub(one, c.f[a]);
        c.cell[a] = v_truncate(cell);
        if (level->hashed) {
            c.low[a] = hash_axis(a, c.cell[a]);
            c.high[a] = hash_axis(a, vi_add(c.cell[a], vi_set(1)));
            continue;
        }
        c.low[a] = vi_mul(c.cell[a], vi_set(stride));
        c.high[a] = vi_add(c.low[a], vi_set(stride));
        stride *= level->resolution + 2;
    }
    return c;
}

V_INLINE vi corner_index(const cn_level *level, const corners *c, int i)
{
    const vi x = (i & 1) ? c->high[0] : c->low[0], y = (i & 2) ? c->high[1] : c->low[1],
             z = (i & 4) ? c->high[2] : c->low[2];
    if (!level->hashed) return vi_add(vi_add(x, y), z);
    return vi_and(vi_xor(vi_xor(x, y), z), vi_set(level->entries - 1));
}

/* The indices of a panel's corners. They are computed first, so that the corners can be prefetched one panel ahead. */
typedef struct panel_corners {
    _Alignas(64) uint32_t index[8][CN_PANEL];
    _Alignas(64) float f[3][CN_PANEL];
} panel_corners;

V_INLINE void find_panel(panel_corners *c, const cn_level *level, const float *pos)
{
    for (uint32_t lane = 0; lane < CN_PANEL; lane += V_LANES) {
        const corners at = corners_of(level, pos + lane);
        V_UNROLL for (int i = 0; i < 8; i++) if (level->hashed || !(i & 1))
            vi_store(c->index[i] + lane, corner_index(level, &at, i));
        V_UNROLL for (int a = 0; a < 3; a++) v_store(c->f[a] + lane, at.f[a]);
    }
}

/* Corners i and i + 1 are neighbours along x, mostly in one cache line: prefetch the lower one only. */
V_INLINE void fetch_panel(const panel_corners *c, const uint32_t *table)
{
    V_UNROLL for (int i = 0; i < 8; i += 2) V_UNROLL for (uint32_t lane = 0; lane < CN_PANEL; lane++)
        __builtin_prefetch(table + c->index[i][lane]);
}

V_INLINE void encode_panel(const bool hashed, const panel_corners *c, const uint32_t *table, float *out)
{
    const vi high = vi_set(0xffff0000u);
    for (uint32_t lane = 0; lane < CN_PANEL; lane += V_LANES) {
        vf sum0 = v_set(0), sum1 = v_set(0), f[3], g[3];
        V_UNROLL for (int a = 0; a < 3; a++)
        {
            f[a] = v_load(c->f[a] + lane);
            g[a] = v_sub(v_set(1), f[a]);
        }
        V_UNROLL for (int i = 0; i < 8; i += 2)
        {
            vi pair[2];
            if (hashed) {
                pair[0] = vi_collect(table, c->index[i] + lane);
                pair[1] = vi_collect(table, c->index[i + 1] + lane);
            } else {
                vi_collect_two(table, c->index[i] + lane, pair);
            }
            const vf yz = v_mul((i & 2) ? f[1] : g[1], (i & 4) ? f[2] : g[2]);
            V_UNROLL for (int k = 0; k < 2; k++)
            {
                const vf w = v_mul(k ? f[0] : g[0], yz);
                sum0 = v_fma(w, v_from_bits(vi_left(pair[k], 16)), sum0);
                sum1 = v_fma(w, v_from_bits(vi_and(pair[k], high)), sum1);
            }
        }
        v_store(out + lane, sum0);
        v_store(out + CN_PANEL + lane, sum1);
    }
}

/* Tables of at least this many bytes are prefetched. Without that, few cache misses run in parallel. */
enum { FETCH_FROM = 256 << 10 };

static void simd_encode(const cn_level *level, const uint32_t *table, const float *pos, size_t n_panels, float *out,
                        size_t out_stride)
{
    const bool fetch = level->entries * sizeof *table >= FETCH_FROM;
    panel_corners c[2];
    for (size_t p = 0; p <= n_panels; p++) {
        if (p < n_panels) {
            find_panel(&c[p & 1], level, pos + p * 3 * CN_PANEL);
            if (fetch) fetch_panel(&c[p & 1], table);
        }
        if (!p) continue;
        if (level->hashed)
            encode_panel(true, &c[~p & 1], table, out + (p - 1) * out_stride);
        else
            encode_panel(false, &c[~p & 1], table, out + (p - 1) * out_stride);
    }
}

/* V_LANES samples, stored so that they can be taken one by one. */
typedef struct scatter {
    _Alignas(64) uint32_t index[8][V_LANES];
    _Alignas(64) uint32_t cell[3][V_LANES]; /* the lower vertex */
    _Alignas(64) float f[3][V_LANES], g[3][V_LANES], d0[V_LANES], d1[V_LANES];
} scatter;

V_INLINE void scatter_fill(scatter *s, const cn_level *level, const float *pos, vf d0, vf d1)
{
    const corners c = corners_of(level, pos);
    V_UNROLL for (int i = 0; i < 8; i++) vi_store(s->index[i], corner_index(level, &c, i));
    V_UNROLL for (int a = 0; a < 3; a++)
    {
        vi_store(s->cell[a], c.cell[a]);
        v_store(s->f[a], c.f[a]);
        v_store(s->g[a], c.g[a]);
    }
    v_store(s->d0, d0);
    v_store(s->d1, d1);
}

/* Gradients of the eight corners of sample q: sum[0] holds pairs of corners 0 to 3, sum[1] of 4 to 7. */
V_INLINE void scatter_add(const scatter *s, int q, __m256 sum[2])
{
    const __m256 x = _mm256_blend_ps(_mm256_broadcast_ss(&s->g[0][q]), _mm256_broadcast_ss(&s->f[0][q]), 0xaa);
    const __m256 y = _mm256_blend_ps(_mm256_broadcast_ss(&s->g[1][q]), _mm256_broadcast_ss(&s->f[1][q]), 0xcc);
    const __m256 z = _mm256_blend_ps(_mm256_broadcast_ss(&s->g[2][q]), _mm256_broadcast_ss(&s->f[2][q]), 0xf0);
    const __m256 d = _mm256_blend_ps(_mm256_broadcast_ss(&s->d0[q]), _mm256_broadcast_ss(&s->d1[q]), 0xaa);
    const __m256 w = _mm256_mul_ps(_mm256_mul_ps(x, y), z);
    sum[0] = _mm256_fmadd_ps(_mm256_permutevar8x32_ps(w, _mm256_setr_epi32(0, 0, 1, 1, 2, 2, 3, 3)), d, sum[0]);
    sum[1] = _mm256_fmadd_ps(_mm256_permutevar8x32_ps(w, _mm256_setr_epi32(4, 4, 5, 5, 6, 6, 7, 7)), d, sum[1]);
}

/* Where gradients are added. Without `touched`, the shift makes every entry mark one spare byte. */
_Static_assert(CN_TOUCH == 8, "the shift below");
typedef struct target {
    cn_range range;
    float *grad;
    uint8_t *touched;
    int shift;
} target;

/* Corners i and i + 1 are neighbours along x, so never the same entry. */
V_INLINE void scatter_two(const scatter *s, int q, int i, __m128 sum, const target *to, bool whole)
{
    const uint32_t a = s->index[i][q] - to->range.first, b = s->index[i + 1][q] - to->range.first;
    double *at_a = (double *)(void *)(to->grad + 2 * (size_t)a), *at_b = (double *)(void *)(to->grad + 2 * (size_t)b);
    const __m128d add = _mm_castps_pd(sum);
    if (whole) {
        const __m128 old = _mm_castpd_ps(_mm_loadh_pd(_mm_load_sd(at_a), at_b));
        const __m128d now = _mm_castps_pd(_mm_add_ps(old, _mm_castpd_ps(add)));
        _mm_storel_pd(at_a, now);
        _mm_storeh_pd(at_b, now);
        to->touched[a >> to->shift] = to->touched[b >> to->shift] = 1;
        return;
    }
    if (a < to->range.count) {
        _mm_store_sd(at_a, _mm_castps_pd(_mm_add_ps(_mm_castpd_ps(_mm_load_sd(at_a)), sum)));
        to->touched[a >> to->shift] = 1;
    }
    if (b < to->range.count) {
        _mm_store_sd(at_b, _mm_castps_pd(_mm_add_ps(_mm_castpd_ps(_mm_load_sd(at_b)), _mm_movehl_ps(sum, sum))));
        to->touched[b >> to->shift] = 1;
    }
}

V_INLINE void scatter_flush(const scatter *s, int q, const __m256 sum[2], const target *to, bool whole)
{
    V_UNROLL for (int h = 0; h < 2; h++)
    {
        scatter_two(s, q, 4 * h, _mm256_castps256_ps128(sum[h]), to, whole);
        scatter_two(s, q, 4 * h + 2, _mm256_extractf128_ps(sum[h], 1), to, whole);
    }
}

/* Consecutive samples in one cell are summed first and added to the table once. On coarse levels most samples of a ray
 * are. */
V_INLINE void scatter_all(const scatter *s, uint32_t live, const target *to, bool whole)
{
    while (live) {
        const int q = __builtin_ctz(live);
        __m256 sum[2] = { _mm256_setzero_ps(), _mm256_setzero_ps() };
        for (;;) {
            const int r = __builtin_ctz(live);
            scatter_add(s, r, sum);
            live &= live - 1;
            if (!live) break;
            const int next = __builtin_ctz(live);
            if (s->cell[0][next] != s->cell[0][q] || s->cell[1][next] != s->cell[1][q] ||
                s->cell[2][next] != s->cell[2][q])
                break;
        }
        scatter_flush(s, q, sum, to, whole);
    }
}

static void simd_encode_backward(const cn_level *level, const cn_encode_gradient *in)
{
    const bool whole = in->range->first == 0 && in->range->count == level->entries;
    uint8_t spare;
    const target to = { *in->range, in->grad, in->touched ? in->touched : &spare, in->touched ? 3 : 31 };
    scatter s;
    for (size_t p = 0; p < in->n_panels; p++) {
        const float *row = in->d_enc + p * in->stride, *pos = in->pos + p * 3 * CN_PANEL;
        for (uint32_t lane = 0; lane < CN_PANEL; lane += V_LANES) {
            const vf d0 = v_load(row + lane), d1 = v_load(row + CN_PANEL + lane);
            const uint32_t live = v_lanes(v_or(v_nonzero(d0), v_nonzero(d1)));
            if (!live) continue;
            scatter_fill(&s, level, pos + lane, d0, d1);
            if (whole)
                scatter_all(&s, live, &to, true);
            else
                scatter_all(&s, live, &to, false);
        }
    }
}

/* ---- rays ---- */

/* Contraction; u in [0,1], returns the local scale. */
V_INLINE vf contract(const vf x[3], vf u[3])
{
    const vf one = v_set(1), m = v_max(v_abs(x[0]), v_max(v_abs(x[1]), v_abs(x[2])));
    const vf inv = v_div(one, v_max(m, one)), s = v_mul(v_sub(v_set(2), inv), inv);
    V_UNROLL for (int a = 0; a < 3; a++) u[a] = v_fma(v_mul(x[a], s), v_set(0.25f), v_set(0.5f));
    return s;
}

V_INLINE vi occ_axis(vf u)
{
    return v_truncate(v_min(v_max(v_mul(u, v_set(CN_OCC_RES)), v_set(0)), v_set(CN_OCC_RES - 1)));
}

V_INLINE void along(const cn_box_ray *ray, vf t, vf x[3])
{
    V_UNROLL for (int a = 0; a < 3; a++) x[a] = v_fma(t, v_set(ray->dir[a]), v_set(ray->origin[a]));
}

static uint32_t simd_march(const cn_box_ray *ray, const cn_march *march, const uint32_t *occ, float *t, uint32_t max)
{
    float power[V_LANES], lanes[V_LANES];
    const float first = march->near_t * powf(march->ratio, march->jitter);
    power[0] = 1;
    for (int i = 1; i < V_LANES; i++)
        power[i] = power[i - 1] * march->ratio;
    const vf powers = v_load(power);
    const float stride = power[V_LANES - 1] * march->ratio;
    uint32_t n = 0;
    for (float at = first; at < march->far_t && n < max; at *= stride) {
        const vf tv = v_mul(v_set(at), powers);
        vf x[3], u[3];
        along(ray, tv, x);
        contract(x, u);
        const vi bit = vi_add(occ_axis(u[0]), vi_left(vi_add(occ_axis(u[1]), vi_left(occ_axis(u[2]), 7)), 7));
        const vi word = vi_gather(occ, vi_right(bit, 5));
        const vi full = vi_and(vi_right_by(word, vi_and(bit, vi_set(31))), vi_set(1));
        uint32_t live = vi_equal(full, vi_set(1)) & v_lanes(v_less(tv, v_set(march->far_t)));
        if (!live) continue;
        v_store(lanes, tv);
        for (; live && n < max; live &= live - 1)
            t[n++] = lanes[__builtin_ctz(live)];
    }
    return n;
}

static void simd_place(const cn_box_ray *ray, const float *t, uint32_t n, cn_spacing spacing, cn_lanes to,
                       float *length)
{
    const vf factor = v_set(spacing.step * spacing.inv_extent);
    for (uint32_t i = 0; i < n; i += V_LANES) {
        const uint32_t count = n - i < V_LANES ? n - i : V_LANES;
        float tail[V_LANES] = { 0 }, lanes[3][V_LANES], lengths[V_LANES];
        memcpy(tail, t + i, count * sizeof *t);
        const vf tv = v_load(tail);
        vf x[3], u[3];
        along(ray, tv, x);
        const vf s = contract(x, u);
        V_UNROLL for (int a = 0; a < 3; a++) v_store(lanes[a], u[a]);
        v_store(lengths, v_mul(v_mul(tv, factor), s));
        for (uint32_t q = 0; q < count; q++) {
            const size_t at = to.first + i + q;
            float *lane = to.pos + at / CN_PANEL * (3 * CN_PANEL) + at % CN_PANEL;
            for (int a = 0; a < 3; a++)
                lane[a * CN_PANEL] = lanes[a][q];
            length[i + q] = lengths[q];
        }
    }
}

/* ---- stereo ---- */

/* h[0] x + h[1] y + h[2]. */
V_INLINE vf homogeneous(const float h[3], vf x, vf y)
{
    return v_fma(v_set(h[0]), x, v_fma(v_set(h[1]), y, v_set(h[2])));
}

V_INLINE vf bilinear(const cn_grey_picture *p, vf x, vf y)
{
    const vf zero = v_set(0), half = v_set(0.5f);
    x = v_min(v_max(v_sub(x, half), zero), v_set((float)p->width - 1.001f));
    y = v_min(v_max(v_sub(y, half), zero), v_set((float)p->height - 1.001f));
    const vf x0 = v_floor(x), y0 = v_floor(y), fx = v_sub(x, x0), fy = v_sub(y, y0);
    const vi at = vi_add(vi_mul(v_truncate(y0), vi_set(p->width)), v_truncate(x0));
    const float *low = p->grey + p->width;
    const vf a = v_gather(p->grey, at), b = v_gather(low, at);
    const vf top = v_fma(fx, v_sub(v_gather(p->grey + 1, at), a), a);
    return v_fma(fy, v_sub(v_fma(fx, v_sub(v_gather(low + 1, at), b), b), top), top);
}

static void simd_window_sums(const cn_window *w, const cn_grey_picture *picture, const float h[9], float sums[3])
{
    vf sum[3] = { v_set(0), v_set(0), v_set(0) };
    V_UNROLL for (int i = 0; i < CN_WINDOW; i += V_LANES)
    {
        const vf x = v_load(w->x + i), y = v_load(w->y + i), z = v_div(v_set(1), homogeneous(h + 6, x, y));
        const vf p = bilinear(picture, v_mul(homogeneous(h, x, y), z), v_mul(homogeneous(h + 3, x, y), z));
        const vf wp = v_mul(v_load(w->weight + i), p);
        sum[0] = v_add(sum[0], wp);
        sum[1] = v_fma(wp, p, sum[1]);
        sum[2] = v_fma(wp, v_load(w->value + i), sum[2]);
    }
    for (int k = 0; k < 3; k++) {
        float lanes[V_LANES];
        v_store(lanes, sum[k]);
        sums[k] = 0;
        for (int i = 0; i < V_LANES; i++)
            sums[k] += lanes[i];
    }
}

#include "kernel/kernel_adam.h"
#include "kernel/kernel_match.h"

static void simd_fill(cn_kernel *k)
{
    k->gemm = simd_gemm;
    k->weight_grad = simd_weight_grad;
    k->encode = simd_encode;
    k->encode_backward = simd_encode_backward;
    k->march = simd_march;
    k->place = simd_place;
    k->adam = simd_adam;
    k->adam_table = simd_adam_table;
    k->window_sums = simd_window_sums;
    k->match = simd_match;
}
