/* The distance that a network guessed from the photo, once its scale and shift are known (Yu et al. 2022,
 * "MonoSDF"), or that stereo found. Pulls the field's depth towards it. The pull weakens over the schedule. */
#include "loss/about.h"

#define VARIANCE 0.1f

static bool on(const cn_loss_scene *scene)
{
    return scene->cue;
}

static void add(const cn_loss_ray *ray, cn_loss_grad *grad)
{
    const float scale = ray->scale * ray->cue_weight;
    if (!ray->has_measured) return;
    cn_loss_about_add(ray, ray->log_measured, scale * VARIANCE, scale * ray->cue_deviation, CN_LOSS_WHOLE, grad);
}

static double value(const cn_loss_ray *ray)
{
    const float scale = ray->scale * ray->cue_weight;
    if (!ray->has_measured) return 0;
    return cn_loss_about_value(ray, ray->log_measured, scale * VARIANCE, scale * ray->cue_deviation, CN_LOSS_WHOLE);
}

const cn_loss_term cn_loss_depth_cue = { .name = "depth cue", .on = on, .add = add, .value = value };
