/* What is left at the end of a ray, where no background takes it: a ray that goes on for ever is unlikely. Without this
 * term bright glass would stand for matter. */
#include "loss/loss.h"

#define WEIGHT 0.01f /* times the prior weight */

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
