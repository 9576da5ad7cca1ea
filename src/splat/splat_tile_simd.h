/* The kernels of splat_tile.h on vectors. Compiled once for each instruction set, after a header that defines the
 * vector type. Everything is static, because each object has the same names. */
#include "splat/splat_tile.h"

#include <string.h>

#define V_INLINE static inline __attribute__((always_inline))
#define V_UNROLL _Pragma("GCC unroll 32")

enum { N = CN_SPLAT_TILE_PIXELS, ROW_VECTORS = CN_SPLAT_TILE / V_LANES, CHECK = 32 };

/* e^x for x in [-80, 0]: 2^n times a polynomial of degree 6; the error is 2 units in the last place. */
V_INLINE vf v_exp_negative(vf x)
{
    const vf t = v_mul(v_max(x, v_set(-80)), v_set(1.44269504f));
    const vf n = v_floor(v_add(t, v_set(0.5f))), f = v_sub(t, n);
    vf p = v_set(1.54035304e-4f);
    p = v_fma(p, f, v_set(1.33335581e-3f));
    p = v_fma(p, f, v_set(9.61812911e-3f));
    p = v_fma(p, f, v_set(5.55041087e-2f));
    p = v_fma(p, f, v_set(2.40226507e-1f));
    p = v_fma(p, f, v_set(6.93147181e-1f));
    p = v_fma(p, f, v_set(1));
    return v_from_bits(vi_add(v_bits(p), vi_left(v_truncate(n), 23)));
}

/* A row of a Gaussian. */
typedef struct row_touch {
    vf a, b_dy, c_dy; /* power = dx * (a * dx + b_dy) + c_dy */
    vf x, opacity, least_alpha;
} row_touch;

V_INLINE row_touch row_of(const cn_splat_tile *t, const cn_flat_splat *f, float dy)
{
    return (row_touch){ .a = v_set(-0.5f * f->a),
                        .b_dy = v_set(-f->b * dy),
                        .c_dy = v_set(-0.5f * f->c * dy * dy),
                        .x = v_set(f->x),
                        .opacity = v_set(f->opacity),
                        .least_alpha = v_set(t->least_alpha) };
}

/* alpha of the lanes where it counts, 0 elsewhere; *unclamped: before the limit. */
V_INLINE vf alpha_of(const row_touch *r, vf dx, vf light, vf *unclamped)
{
    const vf power = v_min(v_fma(dx, v_fma(r->a, dx, r->b_dy), r->c_dy), v_set(0));
    *unclamped = v_mul(r->opacity, v_exp_negative(power));
    vf alpha = v_min(*unclamped, v_set(CN_SPLAT_MOST_ALPHA));
    alpha = v_pick(v_less(alpha, r->least_alpha), v_set(0), alpha);
    return v_pick(v_less(light, v_set(CN_SPLAT_LEAST_LIGHT)), v_set(0), alpha);
}

V_INLINE bool is_dark(const float *light)
{
    vf most = v_load(light);
    for (int i = V_LANES; i < N; i += V_LANES)
        most = v_max(most, v_load(light + i));
    return !(~v_lanes(v_less(most, v_set(CN_SPLAT_LEAST_LIGHT))) & (uint32_t)((UINT64_C(1) << V_LANES) - 1));
}

/* The places of a row's pixels. */
V_INLINE void pixel_places(float first, float xs[CN_SPLAT_TILE])
{
    for (int i = 0; i < CN_SPLAT_TILE; i++)
        xs[i] = first + 0.5f + (float)i;
}

V_INLINE void fetch(const cn_splat_tile *t, uint32_t s)
{
    if (s + 8 < t->n) __builtin_prefetch(&t->flats[t->list[s + 8]]);
}

static void simd_forward(const cn_splat_tile *t)
{
    float *red = t->pixels, *green = red + N, *blue = green + N, *light = blue + N, xs[CN_SPLAT_TILE];
    pixel_places((float)t->x, xs);
    memset(t->pixels, 0, 3 * N * sizeof *t->pixels);
    for (int i = 0; i < N; i++)
        light[i] = 1;
    for (uint32_t s = 0; s < t->n; s++) {
        if (s % CHECK == CHECK - 1 && is_dark(light)) return;
        const cn_flat_splat *f = &t->flats[t->list[s]];
        int32_t part[4];
        fetch(t, s);
        cn_splat_part(t, f->box, part);
        const vf r = v_set(f->rgb[0]), g = v_set(f->rgb[1]), b = v_set(f->rgb[2]);
        for (int32_t y = part[1]; y < part[3]; y++) {
            const row_touch row = row_of(t, f, (float)(t->y + y) + 0.5f - f->y);
            for (int32_t q = part[0] / V_LANES; q * V_LANES < part[2]; q++) {
                const int32_t i = y * CN_SPLAT_TILE + q * V_LANES;
                const vf through = v_load(light + i);
                vf unclamped;
                const vf alpha = alpha_of(&row, v_sub(v_load(xs + q * V_LANES), row.x), through, &unclamped);
                const vf weight = v_mul(alpha, through);
                v_store(red + i, v_fma(weight, r, v_load(red + i)));
                v_store(green + i, v_fma(weight, g, v_load(green + i)));
                v_store(blue + i, v_fma(weight, b, v_load(blue + i)));
                v_store(light + i, v_sub(through, weight));
            }
        }
    }
}

/* The sums of the lanes of eight vectors. */
V_INLINE void sum_eight(const vf v[8], float *out)
{
    __m256 r[8];
    V_UNROLL for (int i = 0; i < 8; i++) r[i] = v_halves(v[i]);
    V_UNROLL for (int i = 0; i < 8; i += 2) r[i] = _mm256_hadd_ps(r[i], r[i + 1]);
    V_UNROLL for (int i = 0; i < 8; i += 4) r[i] = _mm256_hadd_ps(r[i], r[i + 2]);
    _mm256_storeu_ps(out,
                     _mm256_add_ps(_mm256_permute2f128_ps(r[0], r[4], 0x20), _mm256_permute2f128_ps(r[0], r[4], 0x31)));
}

/* The state of the pixels while a tile is gone through again. */
typedef struct back_pixels {
    float light[N], left[N], xs[CN_SPLAT_TILE];
} back_pixels;

V_INLINE void back_splat(const cn_splat_tile *t, const cn_flat_splat *f, back_pixels *px, float *sums)
{
    const float *g = t->gradient;
    int32_t part[4];
    vf v[16];
    V_UNROLL for (int k = 0; k < CN_SPLAT_SUMS; k++) v[k] = v_set(0);
    cn_splat_part(t, f->box, part);
    for (int32_t y = part[1]; y < part[3]; y++) {
        const float dy = (float)(t->y + y) + 0.5f - f->y;
        const row_touch row = row_of(t, f, dy);
        for (int32_t q = part[0] / V_LANES; q * V_LANES < part[2]; q++) {
            const int32_t i = y * CN_SPLAT_TILE + q * V_LANES;
            const vf through = v_load(px->light + i), dx = v_sub(v_load(px->xs + q * V_LANES), row.x);
            vf unclamped;
            const vf alpha = alpha_of(&row, dx, through, &unclamped);
            const vf weight = v_mul(alpha, through), clear = v_sub(v_set(1), alpha);
            const vf red = v_load(g + i), green = v_load(g + N + i), blue = v_load(g + 2 * N + i);
            const vf shade =
                v_fma(red, v_set(f->rgb[0]), v_fma(green, v_set(f->rgb[1]), v_mul(blue, v_set(f->rgb[2]))));
            const vf left = v_sub(v_load(px->left + i), v_mul(weight, shade));
            v_store(px->left + i, left);
            v_store(px->light + i, v_sub(through, weight));
            vf p = v_mul(alpha, v_sub(v_mul(through, shade), v_div(left, clear)));
            p = v_pick(v_less(v_set(CN_SPLAT_MOST_ALPHA), unclamped), v_set(0), p);
            const vf p_x = v_mul(p, dx), d_y = v_set(dy), p_y = v_mul(p, d_y);
            v[CN_SUM_P] = v_add(v[CN_SUM_P], p);
            v[CN_SUM_P_X] = v_add(v[CN_SUM_P_X], p_x);
            v[CN_SUM_P_XX] = v_fma(p_x, dx, v[CN_SUM_P_XX]);
            v[CN_SUM_P_Y] = v_add(v[CN_SUM_P_Y], p_y);
            v[CN_SUM_P_XY] = v_fma(p_y, dx, v[CN_SUM_P_XY]);
            v[CN_SUM_P_YY] = v_fma(p_y, d_y, v[CN_SUM_P_YY]);
            v[CN_SUM_RED] = v_fma(weight, red, v[CN_SUM_RED]);
            v[CN_SUM_RED + 1] = v_fma(weight, green, v[CN_SUM_RED + 1]);
            v[CN_SUM_RED + 2] = v_fma(weight, blue, v[CN_SUM_RED + 2]);
            v[CN_SUM_WEIGHT] = v_add(v[CN_SUM_WEIGHT], weight);
        }
    }
    float out[16];
    V_UNROLL for (int k = CN_SPLAT_SUMS; k < 16; k++) v[k] = v_set(0);
    sum_eight(v, out);
    sum_eight(v + 8, out + 8);
    memcpy(sums, out, CN_SPLAT_SUMS * sizeof *sums);
}

static void simd_backward(const cn_splat_tile *t)
{
    back_pixels px;
    const float *g = t->gradient;
    pixel_places((float)t->x, px.xs);
    for (int i = 0; i < N; i++) {
        px.light[i] = 1;
        px.left[i] = 0;
        for (int k = 0; k < 4; k++)
            px.left[i] += g[k * N + i] * t->pixels[k * N + i];
    }
    uint32_t s = 0;
    for (; s < t->n && !(s % CHECK == CHECK - 1 && is_dark(px.light)); s++) {
        const cn_flat_splat *f = &t->flats[t->list[s]];
        fetch(t, s);
        back_splat(t, f, &px, cn_splat_slot(t, f));
    }
    for (; s < t->n; s++) /* behind what is opaque */
        memset(cn_splat_slot(t, &t->flats[t->list[s]]), 0, CN_SPLAT_SUMS * sizeof(float));
}
