/* Cost of the transmittance at a ray's end, for tiles without a background. Few rays really miss
 * every surface. Without
 * this term bright glass becomes opaque. */
#include "loss/loss.h"

#define WEIGHT 0.01f /* multiplied by the prior weight. Not measured apart */

static bool on(const cn_loss_scene *scene)
{
    return !scene->background;
}

static void add(const cn_loss_ray *ray, cn_loss_grad *grad)
{
    if (ray->counts) grad->after += ray->scale * ray->prior_weight * WEIGHT;
}

static double value(const cn_loss_ray *ray)
{
    return ray->counts ? (double)(ray->scale * ray->prior_weight * WEIGHT) * (double)ray->after : 0;
}

const cn_loss_term cn_loss_openness = { .name = "openness", .on = on, .add = add, .value = value };
