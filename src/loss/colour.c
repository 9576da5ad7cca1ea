/* The gradient of the composited colour, spread over the samples. */
#include "loss/loss.h"

#include <stddef.h>

static void add(const cn_loss_ray *ray, cn_loss_grad *grad)
{
    const float *d = ray->d_pixel;
    for (uint32_t i = 0; i < ray->n; i++) {
        const float *colour = ray->colour + 3 * (size_t)i;
        grad->weight[i] += d[0] * colour[0] + d[1] * colour[1] + d[2] * colour[2];
    }
}

static double value(const cn_loss_ray *ray)
{
    double sum = 0;
    for (uint32_t i = 0; i < ray->n; i++)
        for (size_t c = 0; c < 3; c++)
            sum += (double)ray->weight[i] * (double)ray->d_pixel[c] * (double)ray->colour[3 * (size_t)i + c];
    return sum;
}

const cn_loss_term cn_loss_colour = { .name = "colour", .add = add, .value = value };
