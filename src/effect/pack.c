#include "effect/effect.h"

#include <string.h>

static void add(cn_effect_stage *stage, uint32_t step)
{
    stage->step[stage->n++] = (uint8_t)step;
}

static void fill_stages(cn_effect_pack *pack, double progress, bool render)
{
    pack->ray.n = pack->background.n = pack->pixel.n = pack->loss.n = 0;
    pack->single_view = false;
    for (uint32_t i = 0; i < pack->n_on; i++) {
        const cn_effect *e = pack->on[i].effect;
        if (progress < (double)e->start || (render && e->training_only)) continue;
        if (e->ray) add(&pack->ray, i);
        if (e->background) add(&pack->background, i);
        if (e->pixel) add(&pack->pixel, i);
        if (e->loss) add(&pack->loss, i);
        pack->single_view = pack->single_view || e->wants_support;
    }
}

static void pack_one(cn_effect_pack *pack, const cn_effect *effect)
{
    pack->on[pack->n_on] =
        (cn_effect_step){ effect, pack->conditioning, pack->n_constants, pack->n_photo, pack->n_shared, pack->saved };
    if (effect->field_in) add(&pack->field_in, pack->n_on);
    pack->n_on++;
    pack->conditioning += effect->conditioning;
    pack->harmonics += effect->harmonics ? effect->conditioning : 0;
    pack->n_constants += (size_t)effect->photo_constants * pack->n_rows;
    pack->n_photo += (size_t)effect->photo_params * pack->n_rows;
    pack->n_shared += effect->shared_params;
    pack->saved += effect->saved;
    pack->wants_uv = pack->wants_uv || effect->wants_uv;
    pack->wants_sky_hints = pack->wants_sky_hints || effect->wants_sky_hints;
    pack->moves_rays = pack->moves_rays || effect->ray;
    pack->wants_runs = pack->wants_runs || effect->wants_runs;
    pack->wants_support = pack->wants_support || effect->wants_support;
    pack->wants_stereo = pack->wants_stereo || effect->wants_stereo;
    pack->wants_vignetting = pack->wants_vignetting || effect->wants_vignetting;
    pack->own_rates = pack->own_rates || effect->rate > 0;
}

cn_status cn_effect_pack_make(cn_effect_pack *pack, uint32_t n, const char *const *names, uint32_t n_photos)
{
    memset(pack, 0, sizeof *pack);
    pack->n_rows = n_photos;
    for (uint32_t i = 0; i < n; i++)
        if (!cn_effect_find(names[i]))
            return cn_fail(CN_ERR_CONFIG,
                           "effect '%s' is unknown to this version; run `conurb plan` again or use a newer Conurb",
                           names[i]);
    for (uint32_t e = 0; e < cn_effect_count; e++)
        for (uint32_t i = 0; i < n; i++) {
            const cn_effect *effect = cn_effect_find(names[i]);
            if (strcmp(cn_effect_list[e]->name, effect->name) != 0) continue;
            pack_one(pack, effect);
            break;
        }
    fill_stages(pack, 1, false);
    return CN_OK;
}

void cn_effect_pack_at(cn_effect_pack *pack, double progress)
{
    fill_stages(pack, progress, false);
}
void cn_effect_pack_for_render(cn_effect_pack *pack)
{
    fill_stages(pack, 1, true);
}

static cn_effect_data data_of(const cn_effect_step *s, const cn_effect_state *state)
{
    return (cn_effect_data){ state->kernel, state->constants + s->constants, state->photo + s->photo,
                             state->shared + s->shared, state->derived + s->shared };
}

static cn_effect_grad grad_of(const cn_effect_step *s, const cn_effect_grad *grad)
{
    return (cn_effect_grad){ grad->photo + s->photo, grad->shared + s->shared };
}

void cn_effects_init(const cn_effect_pack *pack, uint64_t seed, float *shared)
{
    for (uint32_t i = 0; i < pack->n_on; i++)
        if (pack->on[i].effect->init) pack->on[i].effect->init(seed, shared + pack->on[i].shared);
}

void cn_effects_derive(const cn_effect_pack *pack, const float *shared, float *derived)
{
    for (uint32_t i = 0; i < pack->n_on; i++)
        if (pack->on[i].effect->derive)
            pack->on[i].effect->derive(shared + pack->on[i].shared, derived + pack->on[i].shared);
}

void cn_effects_centre(const cn_effect_pack *pack, uint32_t n_trained, float *constants)
{
    for (uint32_t i = 0; i < pack->n_on; i++)
        if (pack->on[i].effect->centre)
            pack->on[i].effect->centre(constants + pack->on[i].constants, pack->n_rows, n_trained);
}

void cn_effects_project(const cn_effect_pack *pack, const cn_effect_photos *photos, float *rows, double progress)
{
    for (uint32_t i = 0; i < pack->n_on; i++) {
        const cn_effect_step *s = &pack->on[i];
        cn_effect_photos own = *photos;
        own.constants += s->constants;
        if (s->effect->project) s->effect->project(&own, rows + s->photo, progress);
    }
}

uint32_t cn_effects_rates(const cn_effect_pack *pack, size_t first[CN_MAX_EFFECTS + 1], float factor[CN_MAX_EFFECTS])
{
    for (uint32_t i = 0; i < pack->n_on; i++) {
        first[i] = pack->on[i].photo;
        factor[i] = pack->on[i].effect->rate > 0 ? pack->on[i].effect->rate : 1;
    }
    first[pack->n_on] = pack->n_photo;
    return pack->n_on;
}

void cn_effects_ray(const cn_effect_pack *pack, const cn_effect_rays *rays, const cn_effect_state *state,
                    float (*origin)[3], float (*dir)[3])
{
    for (uint32_t i = 0; i < pack->ray.n; i++) {
        const cn_effect_step *s = &pack->on[pack->ray.step[i]];
        const cn_effect_data data = data_of(s, state);
        s->effect->ray(rays, &data, origin, dir);
    }
}

void cn_effects_ray_backward(const cn_effect_pack *pack, const cn_effect_rays *rays, const cn_effect_state *state,
                             float (*d_origin)[3], float (*d_dir)[3], const cn_effect_grad *grad)
{
    for (uint32_t i = 0; i < pack->ray.n; i++) {
        const cn_effect_step *s = &pack->on[pack->ray.step[i]];
        const cn_effect_data data = data_of(s, state);
        const cn_effect_grad g = grad_of(s, grad);
        s->effect->ray_backward(rays, &data, d_origin, d_dir, &g);
    }
}

void cn_effects_field_in(const cn_effect_pack *pack, const cn_effect_rays *rays, const cn_effect_state *state,
                         float *conditioning, size_t stride)
{
    for (uint32_t i = 0; i < pack->field_in.n; i++) {
        const cn_effect_step *s = &pack->on[pack->field_in.step[i]];
        const cn_effect_data data = data_of(s, state);
        s->effect->field_in(rays, &data, conditioning + s->conditioning, stride);
    }
}

void cn_effects_field_in_backward(const cn_effect_pack *pack, const cn_effect_rays *rays, const cn_effect_state *state,
                                  const float *d_conditioning, size_t stride, const cn_effect_grad *grad)
{
    for (uint32_t i = 0; i < pack->field_in.n; i++) {
        const cn_effect_step *s = &pack->on[pack->field_in.step[i]];
        const cn_effect_data data = data_of(s, state);
        const cn_effect_grad g = grad_of(s, grad);
        if (s->effect->field_in_backward)
            s->effect->field_in_backward(rays, &data, d_conditioning + s->conditioning, stride, &g);
    }
}

bool cn_effects_describe(const cn_effect_pack *pack, const cn_effect_state *state, cn_device_sky *sky)
{
    *sky = (cn_device_sky){ 0 };
    if (!pack->background.n) return true;
    const cn_effect_step *s = &pack->on[pack->background.step[0]];
    if (pack->background.n > 1 || !s->effect->describe) return false;
    const cn_effect_data data = data_of(s, state);
    s->effect->describe(&data, sky);
    return true;
}

void cn_effects_shade(const cn_effect_pack *pack, const cn_effect_rays *rays, const cn_effect_state *state,
                      const float *transmittance, float *rgb, float *saved)
{
    for (uint32_t i = 0; i < pack->background.n && transmittance; i++) {
        const cn_effect_step *s = &pack->on[pack->background.step[i]];
        const cn_effect_data data = data_of(s, state);
        s->effect->background(rays, &data, transmittance, rgb, saved + s->saved * CN_EFFECT_RAYS);
    }
    for (uint32_t i = 0; i < pack->pixel.n; i++) {
        const cn_effect_step *s = &pack->on[pack->pixel.step[i]];
        const cn_effect_data data = data_of(s, state);
        s->effect->pixel(rays, &data, rgb, saved + s->saved * CN_EFFECT_RAYS);
    }
}

float cn_effects_cover(const cn_effect_pack *pack, const float dir[3])
{
    float open = 1;
    for (uint32_t i = 0; i < pack->background.n; i++) {
        const cn_effect *effect = pack->on[pack->background.step[i]].effect;
        open *= effect->cover ? 1 - effect->cover(dir) : 0;
    }
    return 1 - open;
}

double cn_effects_loss(const cn_effect_pack *pack, const cn_effect_rays *rays, const cn_effect_state *state,
                       const cn_effect_residuals *residuals, float *factor, float *saved)
{
    double sum = 0;
    for (uint32_t i = 0; i < rays->n; i++) {
        factor[i] = 1;
        sum += (double)residuals->scale[i] * (double)residuals->error[i];
    }
    for (uint32_t i = 0; i < pack->loss.n; i++) {
        const cn_effect_step *s = &pack->on[pack->loss.step[i]];
        const cn_effect_data data = data_of(s, state);
        sum += s->effect->loss(rays, &data, residuals, factor, saved + s->saved * CN_EFFECT_RAYS);
    }
    return sum;
}

void cn_effects_shade_backward(const cn_effect_pack *pack, const cn_effect_rays *rays, const cn_effect_state *state,
                               const cn_effect_shading *shading, const cn_effect_grad *grad)
{
    memset(shading->d_transmittance, 0, rays->n * sizeof *shading->d_transmittance);
    for (uint32_t i = pack->pixel.n; i-- > 0;) {
        const cn_effect_step *s = &pack->on[pack->pixel.step[i]];
        const cn_effect_data data = data_of(s, state);
        const cn_effect_grad g = grad_of(s, grad);
        s->effect->pixel_backward(rays, &data, shading->d_rgb, shading->saved + s->saved * CN_EFFECT_RAYS, &g);
    }
    for (uint32_t i = pack->background.n; i-- > 0;) {
        const cn_effect_step *s = &pack->on[pack->background.step[i]];
        const cn_effect_data data = data_of(s, state);
        const cn_effect_grad g = grad_of(s, grad);
        cn_effect_shading own = *shading;
        own.saved += s->saved * CN_EFFECT_RAYS;
        s->effect->background_backward(rays, &data, &own, &g);
    }
}
