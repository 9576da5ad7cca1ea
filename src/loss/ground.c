/* Cost of the transmittance at the end of a ray below the horizon, in tiles with a sky. The ray ends in black there, so
 * what is black in a photo, as ground at night, needs no matter, but other views would show a hole. The cost goes by
 * the square, as the error before a background of random colours would. In proportion, as in openness.c, it left dark
 * smears on the ground of castle. Figures are in tests/bench/experiments.md. */
#include "loss/loss.h"

#define WEIGHT 0.01f /* multiplied by the prior weight. As in openness.c; not measured apart */

static bool on(const cn_loss_scene *scene)
{
    return scene->background;
}

static float weight(const cn_loss_ray *ray)
{
    return ray->counts ? ray->scale * ray->prior_weight * WEIGHT * (1 - ray->covered) : 0;
}

static void add(const cn_loss_ray *ray, cn_loss_grad *grad)
{
    grad->after += 2 * weight(ray) * ray->after;
}

static double value(const cn_loss_ray *ray)
{
    return (double)weight(ray) * (double)ray->after * (double)ray->after;
}

const cn_loss_term cn_loss_ground = { .name = "ground", .on = on, .add = add, .value = value };
