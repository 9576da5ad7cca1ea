/* The plain version of the kernels of splat_tile.h. */
#include "splat/splat_tile.h"

#include <math.h>
#include <string.h>

enum { N = CN_SPLAT_TILE_PIXELS };

/* What a Gaussian does at a pixel. */
typedef struct touch {
    float dx, dy, alpha;
    bool clamped;
} touch;

static bool touches(const cn_splat_tile *t, const cn_flat_splat *f, const int32_t px[2], touch *at)
{
    at->dx = (float)(t->x + px[0]) + 0.5f - f->x;
    at->dy = (float)(t->y + px[1]) + 0.5f - f->y;
    const float power = -0.5f * (f->a * at->dx * at->dx + f->c * at->dy * at->dy) - f->b * at->dx * at->dy;
    const float alpha = f->opacity * expf(fminf(power, 0));
    at->clamped = alpha > CN_SPLAT_MOST_ALPHA;
    at->alpha = fminf(alpha, CN_SPLAT_MOST_ALPHA);
    return at->alpha >= t->least_alpha;
}

static void ref_forward(const cn_splat_tile *t)
{
    float *light = t->pixels + 3 * N;
    memset(t->pixels, 0, 3 * N * sizeof *t->pixels);
    for (int i = 0; i < N; i++)
        light[i] = 1;
    for (uint32_t s = 0; s < t->n; s++) {
        const cn_flat_splat *f = &t->flats[t->list[s]];
        int32_t part[4];
        touch at;
        cn_splat_part(t, f->box, part);
        for (int32_t y = part[1]; y < part[3]; y++)
            for (int32_t x = part[0]; x < part[2]; x++) {
                const int32_t i = y * CN_SPLAT_TILE + x;
                if (light[i] < CN_SPLAT_LEAST_LIGHT) continue;
                if (!touches(t, f, (const int32_t[2]){ x, y }, &at)) continue;
                for (int k = 0; k < 3; k++)
                    t->pixels[k * N + i] += at.alpha * light[i] * f->rgb[k];
                light[i] *= 1 - at.alpha;
            }
    }
}

/* left: of each pixel, the product of the gradient with what the Gaussians behind add. */
static void pixel_backward(const cn_flat_splat *f, const touch *at, const float gradient[3], float *light, float *left,
                           float *sums)
{
    const float weight = at->alpha * *light;
    const float shade = gradient[0] * f->rgb[0] + gradient[1] * f->rgb[1] + gradient[2] * f->rgb[2];
    *left -= weight * shade;
    const float by_alpha = *light * shade - *left / (1 - at->alpha);
    const float p = at->clamped ? 0 : by_alpha * at->alpha;
    const float values[6] = {
        p, p * at->dx, p * at->dx * at->dx, p * at->dy, p * at->dx * at->dy, p * at->dy * at->dy
    };
    for (int k = 0; k < 6; k++)
        sums[CN_SUM_P + k] += values[k];
    for (int k = 0; k < 3; k++)
        sums[CN_SUM_RED + k] += weight * gradient[k];
    sums[CN_SUM_WEIGHT] += weight;
    *light *= 1 - at->alpha;
}

static void ref_backward(const cn_splat_tile *t)
{
    float light[N], left[N];
    const float *g = t->gradient;
    for (int i = 0; i < N; i++) {
        light[i] = 1;
        left[i] = 0;
        for (int k = 0; k < 4; k++)
            left[i] += g[k * N + i] * t->pixels[k * N + i];
    }
    for (uint32_t s = 0; s < t->n; s++) {
        const cn_flat_splat *f = &t->flats[t->list[s]];
        float sums[CN_SPLAT_SUMS] = { 0 };
        int32_t part[4];
        touch at;
        cn_splat_part(t, f->box, part);
        for (int32_t y = part[1]; y < part[3]; y++)
            for (int32_t x = part[0]; x < part[2]; x++) {
                const int32_t i = y * CN_SPLAT_TILE + x;
                if (light[i] < CN_SPLAT_LEAST_LIGHT) continue;
                if (!touches(t, f, (const int32_t[2]){ x, y }, &at)) continue;
                const float gradient[3] = { g[i], g[N + i], g[2 * N + i] };
                pixel_backward(f, &at, gradient, &light[i], &left[i], sums);
            }
        memcpy(cn_splat_slot(t, f), sums, sizeof sums);
    }
}

const cn_splat_kernel cn_splat_kernel_ref = { "ref", ref_forward, ref_backward };
