/* How widely a ray's weights are spread about a distance: variance and mean deviation of log-distance. Private to
 * loss/. */
#ifndef CONURB_LOSS_ABOUT_H
#define CONURB_LOSS_ABOUT_H
#include "loss/loss.h"

#include <math.h>

static inline void cn_loss_about_add(const cn_loss_ray *ray, float place, float squared, float linear,
                                     cn_loss_grad *grad)
{
    for (uint32_t i = 0; i < ray->n; i++) {
        const float off = ray->log_distance[i] - place;
        grad->weight[i] = grad->weight[i] + squared * off * off + linear * fabsf(off);
    }
}

static inline double cn_loss_about_value(const cn_loss_ray *ray, float place, float squared, float linear)
{
    double sum = 0;
    for (uint32_t i = 0; i < ray->n; i++) {
        const double off = (double)ray->log_distance[i] - (double)place;
        sum += (double)ray->weight[i] * ((double)squared * off * off + (double)linear * fabs(off));
    }
    return sum;
}
#endif
