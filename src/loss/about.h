/* How widely a ray's weights are spread about a distance: variance, up to a limit, and mean deviation of
 * log-distance. Private to loss/. */
#ifndef CONURB_LOSS_ABOUT_H
#define CONURB_LOSS_ABOUT_H
#include "loss/loss.h"

#include <math.h>

/* The square may end at a log-distance. Spread and sparse points end it at a factor of two: a ray that is to gain a
 * near surface (a column, a trunk) before a far background has both for a while. With the whole square such surfaces
 * hardly began: a column of a synthetic city, which 18 photos show, ended at 1 m. Tuned on that city and fox. What a
 * depth map or stereo says keeps the whole square: with an end, sceaux lost 0.9 dB (tests/bench/experiments.md). */
#define CN_LOSS_FAR 0.7f
#define CN_LOSS_WHOLE 1e9f

static inline void cn_loss_about_add(const cn_loss_ray *ray, float place, float squared, float linear, float end,
                                     cn_loss_grad *grad)
{
    for (uint32_t i = 0; i < ray->n; i++) {
        const float off = ray->log_distance[i] - place;
        const float cut = fminf(fabsf(off), end);
        grad->weight[i] = grad->weight[i] + squared * cut * cut + linear * fabsf(off);
    }
}

static inline double cn_loss_about_value(const cn_loss_ray *ray, float place, float squared, float linear, float end)
{
    double sum = 0;
    for (uint32_t i = 0; i < ray->n; i++) {
        const double off = (double)ray->log_distance[i] - (double)place;
        const double cut = fmin(fabs(off), (double)end);
        sum += (double)ray->weight[i] * ((double)squared * cut * cut + (double)linear * fabs(off));
    }
    return sum;
}
#endif
