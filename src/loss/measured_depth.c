/* The distance that a depth camera measured. Pulls the field's depth towards it (as sparse_depth.c does), and keeps
 * the space before it empty (after Rematas et al. 2022, "Urban Radiance Fields", line-of-sight loss). */
#include "loss/about.h"

#define VARIANCE 0.1f
#define DEVIATION 0.2f
#define EMPTY 0.1f
/* Part of the distance that counts as near. Depth cameras are right to 1 or 2 %, and so is the march. */
#define BAND 0.05f

static bool on(const cn_loss_scene *scene)
{
    return scene->measured;
}

static void add(const cn_loss_ray *ray, cn_loss_grad *grad)
{
    if (!ray->has_measured) return;
    grad->after += ray->scale * VARIANCE;
    cn_loss_about_add(ray, ray->log_measured, ray->scale * VARIANCE, ray->scale * DEVIATION, CN_LOSS_WHOLE, grad);
    for (uint32_t i = 0; i < ray->n; i++)
        if (ray->log_distance[i] < ray->log_measured - BAND) grad->weight[i] += ray->scale * EMPTY;
}

static double value(const cn_loss_ray *ray)
{
    if (!ray->has_measured) return 0;
    double before = 0;
    for (uint32_t i = 0; i < ray->n; i++)
        if (ray->log_distance[i] < ray->log_measured - BAND) before += (double)ray->weight[i];
    return (double)(ray->scale * VARIANCE) * (double)ray->after + (double)(ray->scale * EMPTY) * before +
           cn_loss_about_value(ray, ray->log_measured, ray->scale * VARIANCE, ray->scale * DEVIATION, CN_LOSS_WHOLE);
}

const cn_loss_term cn_loss_measured_depth = { .name = "measured depth", .on = on, .add = add, .value = value };
