/* Matter that only one photo shows has a small cost. The photo's own transient layer then explains it instead. */
#include "loss/loss.h"

#define WEIGHT 0.12f /* squared error that an opaque ray costs in single-view cells. Not measured apart */

static bool on(const cn_loss_scene *scene)
{
    return scene->single_view;
}

static void add(const cn_loss_ray *ray, cn_loss_grad *grad)
{
    for (uint32_t i = 0; i < ray->n; i++)
        grad->weight[i] += ray->single_view[i] ? ray->scale * WEIGHT : 0;
}

static double value(const cn_loss_ray *ray)
{
    double sum = 0;
    for (uint32_t i = 0; i < ray->n; i++)
        sum += ray->single_view[i] ? (double)ray->weight[i] * (double)(ray->scale * WEIGHT) : 0;
    return sum;
}

const cn_loss_term cn_loss_single_view = { .name = "single view", .on = on, .add = add, .value = value };
