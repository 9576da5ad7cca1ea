/* Cost of the transmittance at a ray's end where no effect gives what lies behind it: in tiles without a sky, and below
 * the horizon. Few rays really miss every surface. Without this term bright glass becomes opaque, and what is black in
 * a photo, as ground at night, needs no matter: other views show a hole there. */
#include "loss/loss.h"

#define WEIGHT 0.01f /* multiplied by the prior weight. Not measured apart */

static float price(const cn_loss_ray *ray)
{
    return ray->counts ? ray->scale * ray->prior_weight * WEIGHT * (1 - ray->covered) : 0;
}

static void add(const cn_loss_ray *ray, cn_loss_grad *grad)
{
    grad->after += price(ray);
}

static double value(const cn_loss_ray *ray)
{
    return (double)price(ray) * (double)ray->after;
}

const cn_loss_term cn_loss_openness = { .name = "openness", .add = add, .value = value };
