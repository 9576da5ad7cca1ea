/* How widely a ray's weights are spread about a distance: variance, up to a limit, and mean deviation of
 * log-distance. Private to loss/. */
#ifndef CONURB_LOSS_ABOUT_H
#define CONURB_LOSS_ABOUT_H
#include "loss/loss.h"

#include <math.h>

/* From this log-distance on, a factor of two, the square grows no more. A ray that is to gain a near surface (a column,
 * a trunk) before a far background has both for a while. With the whole square such surfaces never came: in a synthetic
 * city whole columns were missing in every photo that shows them. Tuned on that city and fox; tests/bench/README.md has
 * the other sets. */
#define CN_LOSS_FAR 0.7f

static inline void cn_loss_about_add(const cn_loss_ray *ray, float place, float squared, float linear,
                                     cn_loss_grad *grad)
{
    for (uint32_t i = 0; i < ray->n; i++) {
        const float off = ray->log_distance[i] - place;
        const float cut = fminf(fabsf(off), CN_LOSS_FAR);
        grad->weight[i] = grad->weight[i] + squared * cut * cut + linear * fabsf(off);
    }
}

static inline double cn_loss_about_value(const cn_loss_ray *ray, float place, float squared, float linear)
{
    double sum = 0;
    for (uint32_t i = 0; i < ray->n; i++) {
        const double off = (double)ray->log_distance[i] - (double)place;
        const double cut = fmin(fabs(off), (double)CN_LOSS_FAR);
        sum += (double)ray->weight[i] * ((double)squared * cut * cut + (double)linear * fabs(off));
    }
    return sum;
}
#endif
