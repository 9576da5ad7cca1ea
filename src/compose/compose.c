#include "conurb/compose.h"

#include <assert.h>
#include <math.h>

cn_compose_options cn_compose_options_default(void)
{
    return (cn_compose_options){.exponent = 4, .reach = 2, .max_tiles = 3};
}

void cn_compose_weights(uint32_t n, const double *distance_m, double exponent, double *weight)
{
    double smallest = INFINITY, sum = 0;
    for (uint32_t i = 0; i < n; i++)
        if (isfinite(distance_m[i])) smallest = fmin(smallest, fmax(distance_m[i], 0));
    for (uint32_t i = 0; i < n; i++) {
        double d = fmax(distance_m[i], 0); /* read before weight[i] is written: they may be the same array */
        /* The ratio is in [0,1], and exactly 1 for the nearest, so the sum is never 0. */
        weight[i] = isfinite(distance_m[i]) ? pow(d == smallest ? 1 : smallest / d, exponent) : 0;
        sum += weight[i];
    }
    for (uint32_t i = 0; i < n && sum > 0; i++) weight[i] /= sum;
}

/* Inserts a tile into the list of the nearest so far (at most max); the new length. */
static uint32_t insert_nearest(uint32_t n, uint32_t max, uint32_t tile, double distance, uint32_t *chosen, double *distances)
{
    uint32_t at = n;
    while (at > 0 && distance < distances[at - 1]) at--;
    if (at == max) return n;
    if (n < max) n++;
    for (uint32_t i = n - 1; i > at; i--) {
        chosen[i] = chosen[i - 1];
        distances[i] = distances[i - 1];
    }
    chosen[at] = tile;
    distances[at] = distance;
    return n;
}

uint32_t cn_compose_choose(uint32_t n_tiles, const double (*centre)[3], const double *radius_m, const double camera[3],
                           const cn_compose_options *options, uint32_t *chosen, double *weight)
{
    uint32_t n = 0, nearest = 0;
    double smallest = INFINITY;
    if (options->max_tiles == 0) return 0;
    for (uint32_t i = 0; i < n_tiles; i++) {
        double d = hypot(camera[0] - centre[i][0], camera[1] - centre[i][1]);
        if (!isfinite(d)) continue;
        if (d < smallest) {
            smallest = d;
            nearest = i;
        }
        if (d <= options->reach * radius_m[i]) n = insert_nearest(n, options->max_tiles, i, d, chosen, weight);
    }
    if (n == 0 && isfinite(smallest)) n = insert_nearest(0, 1, nearest, smallest, chosen, weight);
    cn_compose_weights(n, weight, options->exponent, weight); /* weight held the distances */
    return n;
}

void cn_compose_add(cn_picture *out, const cn_picture *picture, double weight)
{
    assert(out->width == picture->width && out->height == picture->height);
    size_t n = (size_t)out->width * out->height;
    float w = (float)weight;
    for (size_t i = 0; i < n; i++) {
        for (int c = 0; c < 4; c++) out->rgba[4 * i + c] += w * picture->rgba[4 * i + c];
        out->depth[i] += w * picture->rgba[4 * i + 3] * picture->depth[i];
    }
}

void cn_compose_finish(cn_picture *out)
{
    size_t n = (size_t)out->width * out->height;
    for (size_t i = 0; i < n; i++) {
        float alpha = out->rgba[4 * i + 3];
        out->depth[i] = alpha > 0 ? out->depth[i] / alpha : 0;
    }
}
