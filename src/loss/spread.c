/* Makes a ray's weights narrow about their own mean, which turns fog into surface. */
#include "loss/about.h"

/* Not measured apart. */
#define VARIANCE 0.01f
/* This weight is multiplied by the prior weight. The mean deviation is there because the variance of thin fog is too
 * small to cost anything. Not measured apart. */
#define DEVIATION 0.003f

static void add(const cn_loss_ray *ray, cn_loss_grad *grad)
{
    if (!ray->has_depth)
        cn_loss_about_add(ray, ray->mean, ray->scale * VARIANCE, ray->scale * (ray->prior_weight * DEVIATION),
                          CN_LOSS_FAR, grad);
}

static double value(const cn_loss_ray *ray)
{
    if (ray->has_depth) return 0;
    return cn_loss_about_value(ray, ray->mean, ray->scale * VARIANCE, ray->scale * (ray->prior_weight * DEVIATION),
                               CN_LOSS_FAR);
}

const cn_loss_term cn_loss_spread = { .name = "spread", .add = add, .value = value };
