/* The scalar reference: every kernel in simple, correct C. */
#include "kernel/kernel.h"

#include "base/contraction.h"

#include <math.h>

static void ref_gemm(cn_matrix a, const float *x, float *y, const float *gate, bool relu)
{
    for (uint32_t i = 0; i < a.m; i++) {
        for (uint32_t lane = 0; lane < CN_PANEL; lane++) {
            float sum = 0;
            for (uint32_t j = 0; j < a.k; j++)
                sum += a.a[(size_t)j * a.m + i] * x[(size_t)j * CN_PANEL + lane];
            if (relu && sum < 0) sum = 0;
            if (gate && !(gate[(size_t)i * CN_PANEL + lane] > 0)) sum = 0;
            y[(size_t)i * CN_PANEL + lane] = sum;
        }
    }
}

static void ref_weight_grad(const cn_panel_rows *dy, const cn_panel_rows *x, size_t n_panels, float *dw)
{
    for (uint32_t i = 0; i < dy->n; i++) {
        for (uint32_t j = 0; j < x->n; j++) {
            float sum = 0;
            for (size_t p = 0; p < n_panels; p++) {
                const float *a = dy->data + p * dy->stride + (size_t)i * CN_PANEL;
                const float *b = x->data + p * x->stride + (size_t)j * CN_PANEL;
                for (uint32_t lane = 0; lane < CN_PANEL; lane++)
                    sum += a[lane] * b[lane];
            }
            dw[(size_t)i * x->n + j] += sum;
        }
    }
}

/* Cell and fraction along one axis; positions outside [0,1] (and NaN) are clamped. */
static uint32_t axis_cell(float pos, uint32_t resolution, float *fraction)
{
    float x = pos > 0 ? pos : 0;
    if (x > 1) x = 1;
    x = x * (float)resolution + 0.5f;
    float cell = floorf(x);
    *fraction = x - cell;
    return (uint32_t)cell;
}

static void corners(const cn_level *level, const float *pos, uint32_t index[8], float weight[8])
{
    float f[3];
    uint32_t c[3];
    for (int a = 0; a < 3; a++)
        c[a] = axis_cell(pos[(size_t)a * CN_PANEL], level->resolution, &f[a]);
    for (uint32_t i = 0; i < 8; i++) {
        index[i] = cn_level_entry(level, c[0] + (i & 1), c[1] + ((i >> 1) & 1), c[2] + (i >> 2));
        weight[i] = ((i & 1) ? f[0] : 1 - f[0]) * ((i & 2) ? f[1] : 1 - f[1]) * ((i & 4) ? f[2] : 1 - f[2]);
    }
}

static void ref_encode(const cn_level *level, const uint32_t *table, const float *pos, size_t n_panels, float *out,
                       size_t out_stride)
{
    for (size_t p = 0; p < n_panels; p++) {
        for (uint32_t lane = 0; lane < CN_PANEL; lane++) {
            uint32_t index[8];
            float weight[8], sum[2] = { 0, 0 };
            corners(level, pos + p * 3 * CN_PANEL + lane, index, weight);
            for (int i = 0; i < 8; i++) {
                uint32_t pair = table[index[i]];
                sum[0] += weight[i] * cn_bf16_to_float((uint16_t)pair);
                sum[1] += weight[i] * cn_bf16_to_float((uint16_t)(pair >> 16));
            }
            out[p * out_stride + lane] = sum[0];
            out[p * out_stride + CN_PANEL + lane] = sum[1];
        }
    }
}

static void ref_encode_backward(const cn_level *level, const cn_encode_gradient *in)
{
    for (size_t p = 0; p < in->n_panels; p++) {
        for (uint32_t lane = 0; lane < CN_PANEL; lane++) {
            const float g0 = in->d_enc[p * in->stride + lane], g1 = in->d_enc[p * in->stride + CN_PANEL + lane];
            if (g0 == 0 && g1 == 0) continue;
            uint32_t index[8];
            float weight[8];
            corners(level, in->pos + p * 3 * CN_PANEL + lane, index, weight);
            for (int i = 0; i < 8; i++) {
                const uint32_t at = index[i] - in->range->first; /* wraps round below the range */
                if (at >= in->range->count) continue;
                in->grad[2 * (size_t)at] += weight[i] * g0;
                in->grad[2 * (size_t)at + 1] += weight[i] * g1;
                if (in->touched) in->touched[at / CN_TOUCH] = 1;
            }
        }
    }
}

/* Contraction of mip-NeRF 360 in the maximum norm: the box [-1,1]^3 does not change, the rest of space is mapped into
 * [-2,2]^3; then all to [0,1]^3. Returns the local scale (contracted length per length, tangential). */
static float contract(const float x[3], float u[3])
{
    float m = fmaxf(fabsf(x[0]), fmaxf(fabsf(x[1]), fabsf(x[2])));
    float s = cn_contraction_float(m);
    for (int a = 0; a < 3; a++)
        u[a] = x[a] * s * 0.25f + 0.5f;
    return s;
}

static uint32_t ref_march(const cn_box_ray *ray, const cn_march *march, const uint32_t *occ, float *t, uint32_t max)
{
    uint32_t n = 0;
    float at = march->near_t * powf(march->ratio, march->jitter);
    for (; at < march->far_t && n < max; at *= march->ratio) {
        float x[3], u[3];
        for (int a = 0; a < 3; a++)
            x[a] = ray->origin[a] + at * ray->dir[a];
        contract(x, u);
        uint32_t cell[3];
        for (int a = 0; a < 3; a++) {
            float c = u[a] * CN_OCC_RES;
            cell[a] = c > 0 ? (c < CN_OCC_RES - 1 ? (uint32_t)c : CN_OCC_RES - 1) : 0;
        }
        uint32_t bit = cell[0] + CN_OCC_RES * (cell[1] + CN_OCC_RES * cell[2]);
        if (occ[bit >> 5] >> (bit & 31) & 1) t[n++] = at;
    }
    return n;
}

static void ref_place(const cn_box_ray *ray, const float *t, uint32_t n, cn_spacing spacing, cn_lanes to, float *length)
{
    for (uint32_t i = 0; i < n; i++) {
        float x[3], u[3];
        for (int a = 0; a < 3; a++)
            x[a] = ray->origin[a] + t[i] * ray->dir[a];
        float s = contract(x, u);
        size_t at = to.first + i;
        float *lane = to.pos + at / CN_PANEL * (3 * CN_PANEL) + at % CN_PANEL;
        for (int a = 0; a < 3; a++)
            lane[(size_t)a * CN_PANEL] = u[a];
        length[i] = spacing.step * t[i] * spacing.inv_extent * s;
    }
}

static void adam_one(const cn_adam *adam, float grad, float *p, float *m, float *v)
{
    *m = adam->beta1 * *m + (1 - adam->beta1) * grad;
    *v = adam->beta2 * *v + (1 - adam->beta2) * grad * grad;
    *p -= adam->rate * *m / (sqrtf(*v) + adam->epsilon);
}

static void ref_adam(const cn_adam *adam, float *p, float *m, float *v, float *g, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        adam_one(adam, g[i] + adam->decay * p[i], &p[i], &m[i], &v[i]);
        g[i] = 0;
    }
}

static uint16_t cut(float x, uint32_t dither)
{
    uint32_t bits;
    memcpy(&bits, &x, 4);
    return (uint16_t)((bits + dither) >> 16);
}

static void ref_adam_table(const cn_adam *adam, uint16_t *table, uint16_t *state, float *grad, uint8_t *touched,
                           size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if ((touched && !touched[i / (2 * CN_TOUCH)]) || grad[i] == 0) continue;
        uint16_t *at = cn_state_at(state, i);
        float p = cn_float_join(table[i], at[0]), m = cn_bf16_to_float(at[CN_STATE_M]),
              v = cn_bf16_to_float(at[CN_STATE_V]);
        adam_one(adam, grad[i], &p, &m, &v);
        grad[i] = 0;
        cn_float_split(p, &table[i], &at[0]);
        at[CN_STATE_M] = cut(m, adam->dither);
        at[CN_STATE_V] = cut(v, adam->dither);
    }
    if (touched) memset(touched, 0, (n + 2 * CN_TOUCH - 1) / (2 * CN_TOUCH));
}

static float bilinear(const cn_grey_picture *p, float x, float y)
{
    x = fminf(fmaxf(x - 0.5f, 0), (float)p->width - 1.001f);
    y = fminf(fmaxf(y - 0.5f, 0), (float)p->height - 1.001f);
    const float x0 = floorf(x), y0 = floorf(y), fx = x - x0, fy = y - y0;
    const float *g = p->grey + (size_t)y0 * p->width + (size_t)x0, *low = g + p->width;
    const float a = g[0] + fx * (g[1] - g[0]), b = low[0] + fx * (low[1] - low[0]);
    return a + fy * (b - a);
}

static void ref_window_sums(const cn_window *w, const cn_grey_picture *picture, const float h[9], float sums[3])
{
    sums[0] = sums[1] = sums[2] = 0;
    for (int i = 0; i < CN_WINDOW; i++) {
        const float z = 1 / (h[6] * w->x[i] + h[7] * w->y[i] + h[8]);
        const float p = bilinear(picture, (h[0] * w->x[i] + h[1] * w->y[i] + h[2]) * z,
                                 (h[3] * w->x[i] + h[4] * w->y[i] + h[5]) * z);
        sums[0] += w->weight[i] * p;
        sums[1] += w->weight[i] * p * p;
        sums[2] += w->weight[i] * p * w->value[i];
    }
}

static float tiny_weight(cn_tiny_layer of, size_t i, size_t o)
{
    const uint32_t pair = of.w[i * CN_TINY_PAIRS + o % CN_TINY_PAIRS];
    return cn_bf16_to_float((uint16_t)(o < CN_TINY_PAIRS ? pair : pair >> 16));
}

static void ref_tiny(cn_tiny_layer of, const float *x, uint32_t n, bool relu, float *y)
{
    for (size_t s = 0; s < n; s++)
        for (size_t o = 0; o < CN_TINY; o++) {
            float sum = 0;
            for (size_t i = 0; i < of.k; i++)
                sum += tiny_weight(of, i, o) * x[s * CN_TINY + i];
            y[s * CN_TINY + o] = relu && !(sum > 0) ? 0 : sum;
        }
}

static void ref_tiny_backward(cn_tiny_layer of, const float *dy, uint32_t n, const float *gate, float *dx)
{
    for (size_t s = 0; s < n; s++)
        for (size_t i = 0; i < of.k; i++) {
            float sum = 0;
            for (size_t o = 0; o < CN_TINY; o++)
                sum += tiny_weight(of, i, o) * dy[s * CN_TINY + o];
            dx[s * CN_TINY + i] = gate && !(gate[s * CN_TINY + i] > 0) ? 0 : sum;
        }
}

static void ref_tiny_gradient(uint32_t k, const float *x, const float *dy, uint32_t n, float *grad)
{
    for (size_t s = 0; s < n; s++)
        for (size_t i = 0; i < k; i++)
            for (size_t o = 0; o < CN_TINY; o++)
                grad[2 * (i * CN_TINY_PAIRS + o % CN_TINY_PAIRS) + o / CN_TINY_PAIRS] +=
                    x[s * CN_TINY + i] * dy[s * CN_TINY + o];
}

static void clear_nearest(const cn_nearest *nearest, uint32_t n)
{
    for (uint32_t i = 0; i < n; i++) {
        nearest->best[i] = nearest->second[i] = 0;
        nearest->index[i] = -1;
    }
}

static void see(const cn_nearest *nearest, uint32_t at, int32_t product, uint32_t other)
{
    if (product > nearest->best[at]) {
        nearest->second[at] = nearest->best[at];
        nearest->best[at] = product;
        nearest->index[at] = (int32_t)other;
    } else if (product > nearest->second[at]) {
        nearest->second[at] = product;
    }
}

static void ref_match(cn_descriptors rows, cn_descriptors columns, const cn_nearest *of_rows,
                      const cn_nearest *of_columns)
{
    clear_nearest(of_rows, rows.n);
    clear_nearest(of_columns, columns.n);
    for (uint32_t i = 0; i < rows.n; i++)
        for (uint32_t j = 0; j < columns.n; j++) {
            const uint8_t *a = rows.data + (size_t)i * CN_DESCRIPTOR, *b = columns.data + (size_t)j * CN_DESCRIPTOR;
            int32_t product = 0;
            for (int k = 0; k < CN_DESCRIPTOR; k++)
                product += a[k] * b[k];
            see(of_rows, i, product, j);
            see(of_columns, j, product, i);
        }
}

const cn_kernel cn_kernel_ref = {
    .name = "ref",
    .gemm = ref_gemm,
    .weight_grad = ref_weight_grad,
    .encode = ref_encode,
    .encode_backward = ref_encode_backward,
    .march = ref_march,
    .place = ref_place,
    .adam = ref_adam,
    .adam_table = ref_adam_table,
    .tiny = ref_tiny,
    .tiny_backward = ref_tiny_backward,
    .tiny_gradient = ref_tiny_gradient,
    .window_sums = ref_window_sums,
    .match = ref_match,
};
