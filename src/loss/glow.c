/* Thin matter may not shine. Where a photo is at white, a brighter colour is no error. So a photo's white cloud became
 * matter of 3 % opacity and ten times the brightness of white, and from elsewhere stood before the sky as a bright
 * block. A sample that is brighter than a limit has a cost: the part above the limit, times its weight. The limit is
 * above white, and above what the whole pixel shows, so a surface and a part of one never reach it.
 *
 * Found on sacre-coeur and lund; tests/bench/experiments.md has the other sets. The three numbers were not varied, but
 * for a third of the weight (there too). */
#include "loss/loss.h"

#include <math.h>

#define WEIGHT 0.1f
#define WHITE 1.5f    /* a photo of mean exposure has its white at 1 */
#define OF_PIXEL 4.0f /* times what the pixel shows: a sample that hides a quarter of it may have any colour */

static float limit(const cn_loss_ray *ray)
{
    return fmaxf(WHITE, OF_PIXEL * ray->brightest);
}

static void add(const cn_loss_ray *ray, cn_loss_grad *grad)
{
    const float most = limit(ray), price = WEIGHT * ray->scale;
    if (!ray->counts) return;
    for (uint32_t i = 0; i < ray->n; i++)
        for (uint32_t c = 0; c < 3; c++) {
            const float over = ray->colour[3 * i + c] - most;
            if (!(over > 0)) continue;
            grad->weight[i] += price * over;
            grad->colour[3 * i + c] += price * ray->weight[i];
        }
}

static double value(const cn_loss_ray *ray)
{
    const float most = limit(ray), price = WEIGHT * ray->scale;
    double sum = 0;
    for (uint32_t i = 0; i < ray->n && ray->counts; i++)
        for (uint32_t c = 0; c < 3; c++)
            sum += (double)(price * ray->weight[i]) * (double)fmaxf(ray->colour[3 * i + c] - most, 0);
    return sum;
}

const cn_loss_term cn_loss_glow = { .name = "glow", .add = add, .value = value };
