#include "stereo/window.h"

#include <math.h>
#include <string.h>

/* Spreads of the weights: of grey values, and of distances in pixels (as in Schoenberger et al. 2016). */
#define GREY_SPREAD 0.12f
#define PLACE_SPREAD 5.0f
/* A window of less variance has no texture to match. */
#define LEAST_VARIANCE 1e-6f

enum { SIDE = 5 };

void cn_stereo_pair_init(cn_stereo_pair *pair, const cn_stereo_view *r, const cn_stereo_view *s)
{
    /* rotation = Rs Rr^T, translation = ts - rotation tr. */
    double rotation[9], translation[3];
    for (int i = 0; i < 3; i++) {
        translation[i] = s->pose->translation[i];
        for (int j = 0; j < 3; j++) {
            rotation[3 * i + j] = 0;
            for (int k = 0; k < 3; k++)
                rotation[3 * i + j] += s->pose->rotation[3 * i + k] * r->pose->rotation[3 * j + k];
        }
        for (int j = 0; j < 3; j++)
            translation[i] -= rotation[3 * i + j] * r->pose->translation[j];
    }
    const double f = (double)r->focal;
    for (int i = 0; i < 3; i++) {
        double k[3]; /* row i of Ks times rotation */
        for (int j = 0; j < 3; j++)
            k[j] = i == 2 ? rotation[6 + j]
                          : (double)s->focal * rotation[3 * i + j] + (double)(i ? s->cy : s->cx) * rotation[6 + j];
        pair->a[3 * i] = (float)(k[0] / f);
        pair->a[3 * i + 1] = (float)(k[1] / f);
        pair->a[3 * i + 2] = (float)(k[2] - k[0] * (double)r->cx / f - k[1] * (double)r->cy / f);
        pair->b[i] = (float)(i == 2 ? translation[2]
                                    : (double)s->focal * translation[i] + (double)(i ? s->cy : s->cx) * translation[2]);
    }
    pair->picture = (cn_grey_picture){ s->grey, s->width, s->height };
}

void cn_stereo_window_init(cn_stereo_window *w, const cn_stereo_view *r, uint32_t x, uint32_t y, uint32_t step)
{
    const int apart = (int)step;
    const float here = r->grey[(size_t)y * r->width + x];
    float sum = 0, mean = 0, square = 0;
    w->x = (float)x + 0.5f;
    w->y = (float)y + 0.5f;
    for (int i = 0; i < CN_WINDOW; i++) {
        const bool filler = i >= SIDE * SIDE;
        const int dx = filler ? 0 : apart * (i % SIDE - SIDE / 2), dy = filler ? 0 : apart * (i / SIDE - SIDE / 2);
        int u = (int)x + dx, v = (int)y + dy;
        u = u < 0 ? 0 : u < (int)r->width ? u : (int)r->width - 1;
        v = v < 0 ? 0 : v < (int)r->height ? v : (int)r->height - 1;
        const float value = r->grey[(size_t)v * r->width + (size_t)u], d = value - here;
        const float weight = filler ? 0
                                    : expf(-d * d / (2 * GREY_SPREAD * GREY_SPREAD) -
                                           (float)(dx * dx + dy * dy) / (2 * PLACE_SPREAD * PLACE_SPREAD));
        w->samples.x[i] = (float)u + 0.5f;
        w->samples.y[i] = (float)v + 0.5f;
        w->samples.value[i] = value;
        w->samples.weight[i] = weight;
        sum += weight;
        mean += weight * value;
        square += weight * value * value;
    }
    w->sum = sum;
    w->mean = mean / sum;
    w->variance = square / sum - w->mean * w->mean;
}

float cn_stereo_cost(const cn_kernel *kernel, const cn_stereo_window *w, const cn_stereo_pair *p, const float m[3])
{
    if (w->variance < LEAST_VARIANCE) return 2;
    float h[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            h[3 * i + j] = p->a[3 * i + j] + p->b[i] * m[j];
    const float z = h[6] * w->x + h[7] * w->y + h[8], u = (h[0] * w->x + h[1] * w->y + h[2]) / z,
                v = (h[3] * w->x + h[4] * w->y + h[5]) / z;
    if (!(z > 0 && u > 0 && v > 0 && u < (float)p->picture.width && v < (float)p->picture.height)) return 2;
    float sums[3];
    kernel->window_sums(&w->samples, &p->picture, h, sums);
    const float mean = sums[0] / w->sum, variance = sums[1] / w->sum - mean * mean,
                covariance = sums[2] / w->sum - mean * w->mean;
    return variance < LEAST_VARIANCE ? 2 : 1 - covariance / sqrtf(variance * w->variance);
}
