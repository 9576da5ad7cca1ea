#include "effect/effect.h"

#include <string.h>

static void pack_one(cn_effect_pack *pack, const cn_effect *effect, uint32_t n_photos)
{
    const cn_effect_step step = {effect, pack->columns, pack->n_constants, pack->n_params};
    pack->on[pack->n_on++] = step;
    if (effect->field_in) pack->field_in[pack->n_field_in++] = step;
    if (effect->pixel) pack->pixel[pack->n_pixel++] = step;
    pack->columns += effect->columns;
    pack->n_constants += (size_t)effect->photo_constants * n_photos;
    pack->n_params += (size_t)effect->photo_params * n_photos;
}

cn_status cn_effect_pack_make(cn_effect_pack *pack, uint32_t n, const char *const *names, uint32_t n_photos)
{
    memset(pack, 0, sizeof *pack);
    for (uint32_t i = 0; i < n; i++)
        if (!cn_effect_find(names[i]))
            return cn_fail(CN_ERR_CONFIG, "effect '%s' is unknown to this version; make the plan again or use a newer Conurb",
                           names[i]);
    for (uint32_t e = 0; e < cn_effect_count; e++)
        for (uint32_t i = 0; i < n; i++)
            if (strcmp(cn_effect_list[e]->name, names[i]) == 0) {
                pack_one(pack, cn_effect_list[e], n_photos);
                break;
            }
    return CN_OK;
}

void cn_effects_field_in(const cn_effect_pack *pack, const cn_effect_rays *rays, const float *constants, const float *params,
                         float *columns, size_t stride)
{
    for (uint32_t i = 0; i < pack->n_field_in; i++) {
        const cn_effect_step *s = &pack->field_in[i];
        s->effect->field_in(rays, constants + s->constants, params + s->params, columns + s->column, stride);
    }
}

void cn_effects_field_in_backward(const cn_effect_pack *pack, const cn_effect_rays *rays, const float *constants,
                                  const float *params, const float *d_columns, size_t stride, float *d_params)
{
    for (uint32_t i = 0; i < pack->n_field_in; i++) {
        const cn_effect_step *s = &pack->field_in[i];
        if (s->effect->field_in_backward)
            s->effect->field_in_backward(rays, constants + s->constants, params + s->params, d_columns + s->column, stride,
                                         d_params + s->params);
    }
}

void cn_effects_pixel(const cn_effect_pack *pack, const cn_effect_rays *rays, const float *constants, const float *params,
                      float *rgb, float *trail)
{
    for (uint32_t i = 0; i < pack->n_pixel; i++) {
        const cn_effect_step *s = &pack->pixel[i];
        if (trail) memcpy(trail + (size_t)i * rays->n * 3, rgb, (size_t)rays->n * 3 * sizeof *rgb);
        s->effect->pixel(rays, constants + s->constants, params + s->params, rgb);
    }
}

void cn_effects_pixel_backward(const cn_effect_pack *pack, const cn_effect_rays *rays, const float *constants,
                               const float *params, const float *trail, float *d_rgb, float *d_params)
{
    for (uint32_t i = pack->n_pixel; i-- > 0;) {
        const cn_effect_step *s = &pack->pixel[i];
        s->effect->pixel_backward(rays, constants + s->constants, params + s->params, trail + (size_t)i * rays->n * 3, d_rgb,
                                  d_params + s->params);
    }
}
