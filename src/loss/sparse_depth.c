/* Makes a ray's weights narrow about the sparse point that it goes through (after Deng et al. 2022, "DS-NeRF"). The
 * transmittance at the ray's end has a cost too, because there is matter at a sparse point. */
#include "loss/about.h"

/* Not measured apart. */
#define VARIANCE 0.1f
#define DEVIATION 0.2f

static bool on(const cn_loss_scene *scene)
{
    return scene->sparse;
}

static void add(const cn_loss_ray *ray, cn_loss_grad *grad)
{
    if (!ray->has_depth) return;
    grad->after += ray->scale * VARIANCE;
    cn_loss_about_add(ray, ray->log_depth, ray->scale * VARIANCE, ray->scale * DEVIATION, CN_LOSS_FAR, grad);
}

static double value(const cn_loss_ray *ray)
{
    if (!ray->has_depth) return 0;
    return (double)(ray->scale * VARIANCE) * (double)ray->after +
           cn_loss_about_value(ray, ray->log_depth, ray->scale * VARIANCE, ray->scale * DEVIATION, CN_LOSS_FAR);
}

const cn_loss_term cn_loss_sparse_depth = { .name = "sparse depth", .on = on, .add = add, .value = value };
