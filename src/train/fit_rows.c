#include "train/fit.h"

#include "tile/model.h"

#include <math.h>

/* A trained photo's light is such a light, by its error over the least of them. Found on the city of scripts/run: 0.03
 * and 0.3 give the same there, and on sceaux, sacre-coeur, valley and monstree within 0.1 dB of no such rule. */
#define SUCH_LIGHT 0.1

cn_fit_prior cn_fit_prior_of(const cn_tile *tile, double open)
{
    const size_t first = tile->one.n_constants, n = tile->one.n_photo;
    double sum[CN_APPEARANCE_MAX] = { 0 }, squares[CN_APPEARANCE_MAX] = { 0 }, rows = 0;
    cn_fit_prior prior = { 0 };
    cn_appearance photo;
    for (uint32_t t = 0; t < tile->n_trained; t++) {
        if (cn_tile_appearance(tile, tile->names[t], &photo) != CN_OK) continue;
        rows++;
        for (size_t i = 0; i < n; i++) {
            sum[i] += (double)photo.row[first + i];
            squares[i] += (double)photo.row[first + i] * (double)photo.row[first + i];
        }
    }
    /* One or two photos do not show how rows vary. */
    for (size_t i = 0; i < n; i++) {
        prior.mean[i] = rows > 0 ? sum[i] / rows : 0;
        const double variance = rows > 2 ? (squares[i] - rows * prior.mean[i] * prior.mean[i]) / (rows - 1) : 0;
        prior.precision[i] = variance > 1e-12 ? 1 / variance : 0;
    }
    for (uint32_t e = 0; e < tile->one.n_on; e++) {
        const cn_effect_step *on = &tile->one.on[e];
        const double spread = on->effect->spread;
        for (uint32_t c = 0; spread > 0 && c < on->effect->photo_params; c++)
            prior.precision[on->photo + c] = fmin(prior.precision[on->photo + c], 1 / (spread * spread));
        for (uint32_t c = 0; on->effect->background && c < on->effect->photo_params; c++)
            prior.precision[on->photo + c] *= open;
    }
    return prior;
}

uint32_t cn_fit_starts(const cn_tile *tile)
{
    return tile->n_trained < CN_FIT_STARTS ? tile->n_trained : CN_FIT_STARTS;
}

const char *cn_fit_start_name(const cn_tile *tile, uint32_t i)
{
    return tile->names[(size_t)tile->n_trained * i / cn_fit_starts(tile)];
}

void cn_fit_expect_background(const cn_tile *tile, const double *error, cn_appearance *row)
{
    double least = INFINITY, weights = 0, sum[CN_APPEARANCE_MAX] = { 0 };
    cn_appearance photo;
    for (uint32_t i = 0; i < cn_fit_starts(tile); i++)
        least = fmin(least, error[i]);
    if (!(least > 0)) return;
    for (uint32_t i = 0; i < cn_fit_starts(tile); i++) {
        if (!isfinite(error[i])) continue;
        if (cn_tile_appearance(tile, cn_fit_start_name(tile, i), &photo) != CN_OK) continue;
        const double weight = exp(-(error[i] / least - 1) / SUCH_LIGHT);
        weights += weight;
        for (uint32_t k = 0; k < photo.n; k++)
            sum[k] += weight * (double)photo.row[k];
    }
    for (uint32_t e = 0; e < tile->one.n_on && weights > 0; e++) {
        const cn_effect_step *on = &tile->one.on[e];
        const uint32_t at = tile->one.n_constants + on->photo;
        for (uint32_t c = 0; on->effect->background && c < on->effect->photo_params; c++)
            row->row[at + c] = (float)(sum[at + c] / weights);
    }
}

double cn_fit_agreement(size_t n, const float *start, const float *const fitted[2], const double *precision)
{
    double common = 0, first = 0, second = 0;
    for (size_t i = 0; i < n; i++) {
        const double a = (double)fitted[0][i] - (double)start[i], b = (double)fitted[1][i] - (double)start[i];
        common += a * b * precision[i];
        first += a * a * precision[i];
        second += b * b * precision[i];
    }
    if (!(first > 0) || !(second > 0)) return 1;
    const double cosine = common / sqrt(first * second);
    return cosine > 0 ? 2 * cosine / (1 + cosine) : 0;
}
