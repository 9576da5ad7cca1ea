/* The spread of a ray's matter about its own mean: fog becomes surface. */
#include "loss/about.h"

#define VARIANCE 0.01f
/* Times the prior weight. The mean deviation still costs fog where the variance is next to nothing. */
#define DEVIATION 0.003f

static void add(const cn_loss_ray *ray, cn_loss_grad *grad)
{
    if (!ray->has_depth)
        cn_loss_about_add(ray, ray->mean, ray->scale * VARIANCE, ray->scale * (ray->prior_weight * DEVIATION), grad);
}

static double value(const cn_loss_ray *ray)
{
    if (ray->has_depth) return 0;
    return cn_loss_about_value(ray, ray->mean, ray->scale * VARIANCE, ray->scale * (ray->prior_weight * DEVIATION));
}

const cn_loss_term cn_loss_spread = { .name = "spread", .add = add, .value = value };
