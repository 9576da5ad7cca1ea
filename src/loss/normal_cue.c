/* The surface's direction by the photo's normal map. Two neighbouring rays whose normals agree lie on one plane; each
 * ray's mean depth is pulled to the plane through the other's mean depth. As both rays do so, the gradient is that of
 * one loss over the pair. The error is divided by plane_width, so it is the angle in radians by which the plane through
 * both depths is turned, in first order: one error of a normal costs the same however slanted and however near the
 * surface is. After Yu et al. 2022, "MonoSDF" (normal consistency), but of depths, so that no gradient of the density
 * is needed. The pull weakens as the photos are explained. */
#include "loss/loss.h"

#include <math.h>

/* In flow_normals the median error of depth is 0.067 without normal maps, 0.059 with a weight of 0.05, 0.045 with 0.3
 * and with 1. */
#define WEIGHT 0.3
#define TURN 0.2 /* radians. Larger errors cost in proportion only (pseudo-Huber): they are edges, or wrong normals */

static bool on(const cn_loss_scene *scene)
{
    return scene->normals;
}

/* The angle, the ray's mean log-distance and its opacity. False where the ray has no plane. */
typedef struct turned {
    double angle, mean, total;
} turned;
static bool measure(const cn_loss_ray *ray, turned *t)
{
    *t = (turned){ 0 };
    if (!ray->has_plane) return false;
    for (uint32_t i = 0; i < ray->n; i++) {
        t->total += (double)ray->weight[i];
        t->mean += (double)ray->weight[i] * (double)ray->log_distance[i];
    }
    if (!(t->total > 0)) return false;
    t->mean /= t->total;
    t->angle = (t->mean - (double)ray->log_plane) / (double)ray->plane_width;
    return true;
}

static void add(const cn_loss_ray *ray, cn_loss_grad *grad)
{
    turned t;
    if (!measure(ray, &t)) return;
    const double weight = WEIGHT * (double)ray->scale * (double)ray->cue_weight;
    const double slope = weight * t.angle / sqrt(1 + t.angle * t.angle / (TURN * TURN));
    const double by_mean = slope / ((double)ray->plane_width * t.total);
    for (uint32_t i = 0; i < ray->n; i++)
        grad->weight[i] += (float)(by_mean * ((double)ray->log_distance[i] - t.mean));
}

static double value(const cn_loss_ray *ray)
{
    turned t;
    if (!measure(ray, &t)) return 0;
    const double weight = WEIGHT * (double)ray->scale * (double)ray->cue_weight;
    return weight * TURN * TURN * (sqrt(1 + t.angle * t.angle / (TURN * TURN)) - 1);
}

const cn_loss_term cn_loss_normal_cue = { .name = "normal cue", .on = on, .add = add, .value = value };
