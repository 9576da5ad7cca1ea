/* The sky of tiles of format 1. Here the code is an input of the head. Such tiles are rendered and fitted, but no
 * longer trained. */
#include "effect/effect.h"
#include "effect/head.h"
#include "effect/sky.h"
#include "field/field.h"
#include "rays/rays.h"

#include <math.h>
#include <string.h>

enum { CODE = 8, IN = 16 + CODE, WIDTH = 32, OUT = 4, STREAM = 8 };
static const cn_head head = { IN, WIDTH, OUT };

static void derive(const float *shared, float *derived)
{
    cn_head_transpose(&head, shared, derived);
}

static void background(const cn_effect_rays *rays, const cn_effect_data *data, const float *transmittance, float *rgb,
                       float *saved)
{
    const cn_head_acts a = cn_head_split(&head, saved);
    for (uint32_t i = 0; i < rays->n; i++) {
        float harmonics[16];
        cn_rays_harmonics(rays->dir + 3 * (size_t)i, harmonics);
        for (uint32_t c = 0; c < 16; c++)
            *cn_head_at(a.in, IN, c, i) = harmonics[c];
        for (uint32_t c = 0; c < CODE; c++)
            *cn_head_at(a.in, IN, 16 + c, i) = data->photo[(size_t)rays->photo[i] * CODE + c];
    }
    cn_head_forward(&head, data->kernel, data->derived, rays->n, &a);
    for (uint32_t i = 0; i < rays->n; i++)
        for (uint32_t c = 0; c < 3; c++)
            rgb[3 * (size_t)i + c] += transmittance[i] * cn_sky_cover(rays->dir + 3 * (size_t)i) *
                                      cn_field_light(*cn_head_at(a.out, OUT, c, i));
}

static void background_backward(const cn_effect_rays *rays, const cn_effect_data *data,
                                const cn_effect_shading *shading, const cn_effect_grad *grad)
{
    const cn_head_acts a = cn_head_split(&head, shading->saved);
    for (uint32_t i = 0; i < rays->n; i++) {
        const float open = cn_sky_cover(rays->dir + 3 * (size_t)i);
        for (uint32_t c = 0; c < 3; c++) {
            const float light = cn_field_light(*cn_head_at(a.out, OUT, c, i)), d = shading->d_rgb[3 * (size_t)i + c];
            shading->d_transmittance[i] += d * open * light;
            *cn_head_at(a.d_out, OUT, c, i) = d * shading->transmittance[i] * open * cn_field_light_gradient(light);
        }
        *cn_head_at(a.d_out, OUT, 3, i) = 0;
    }
    cn_head_backward(&head, data->kernel, data->shared, rays->n, &a, grad->shared);
    for (uint32_t i = 0; i < rays->n; i++)
        for (uint32_t c = 0; c < CODE; c++)
            grad->photo[(size_t)rays->photo[i] * CODE + c] += *cn_head_at(a.d_in, IN, 16 + c, i);
}

extern const cn_effect cn_effect_sky_by_input;
const cn_effect cn_effect_sky_by_input = {
    .name = "sky",
    .form = "sky by input",
    .summary = "the sky of tiles of format 1",
    .photo_params = CODE,
    .shared_params = CN_HEAD_WEIGHTS(IN, WIDTH, OUT),
    .saved = CN_HEAD_SAVED(IN, WIDTH, OUT),
    .derive = derive,
    .cover = cn_sky_cover,
    .background = background,
    .background_backward = background_backward,
};
