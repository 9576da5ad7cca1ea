/* The effects of a training step on other devices than the processor: where their parameters are, or, where one of them
 * is not known to the shaders, the parts that the processor does for all of them in the middle of a step. */
#include "effect/runs.h"
#include "train/trainer.h"

#include <string.h>

/* ---- what the processor does ---- */

static cn_effect_grad grad_of(const cn_trainer *t, size_t slot)
{
    float *grad = t->slot_grad + slot * t->parameters.n;
    return (cn_effect_grad){ grad + t->parameters.photo_at, grad + t->parameters.shared_at };
}

static void condition(cn_trainer *t, uint32_t g)
{
    const uint32_t n = t->parameters.field.conditioning;
    const cn_effect_rays rays = cn_train_effects_rays(&t->batch, g);
    const cn_effect_state state = cn_train_effects_state(&t->effects, t->kernel, &t->parameters);
    cn_effects_field_in(&t->effects.pack, &rays, &state, t->device.conditioning + (size_t)g * CN_GROUP * n, n);
}

static void columns(void *user, size_t slot, unsigned worker)
{
    (void)worker;
    cn_trainer *t = user;
    for (uint32_t g = (uint32_t)slot; g < t->batch.n_groups; g += CN_SLOTS)
        condition(t, g);
}

static void columns_backward(void *user, size_t slot, unsigned worker)
{
    (void)worker;
    cn_trainer *t = user;
    const uint32_t n = t->parameters.field.conditioning;
    const cn_effect_grad grad = grad_of(t, slot);
    for (uint32_t g = (uint32_t)slot; g < t->batch.n_groups; g += CN_SLOTS) {
        if (!cn_batch_has(&t->batch, g)) continue;
        const cn_shade shade = cn_trainer_shade(t, g);
        cn_effects_field_in_backward(shade.pack, &shade.rays, &shade.effects,
                                     t->device.d_columns + (size_t)g * CN_GROUP * n, n, &grad);
    }
}

static void rays_backward(void *user, size_t slot, unsigned worker)
{
    (void)worker;
    cn_trainer *t = user;
    const cn_effect_grad grad = grad_of(t, slot);
    for (uint32_t g = (uint32_t)slot; g < t->batch.n_groups; g += CN_SLOTS) {
        if (!cn_batch_has(&t->batch, g)) continue;
        const cn_shade shade = cn_trainer_shade(t, g);
        float d_origin[CN_GROUP][3], d_dir[CN_GROUP][3];
        for (uint32_t r = 0; r < CN_GROUP; r++) {
            const float *d = t->device.d_rays + 8 * ((size_t)g * CN_GROUP + r);
            memcpy(d_origin[r], d, sizeof d_origin[r]);
            memcpy(d_dir[r], d + 4, sizeof d_dir[r]);
        }
        cn_effects_ray_backward(shade.pack, &shade.rays, &shade.effects, d_origin, d_dir, &grad);
    }
}

static void pixels_of_group(cn_trainer *t, uint32_t g, float *saved, const cn_effect_grad *effect_grad,
                            cn_step_stats *stats)
{
    const size_t first = (size_t)g * CN_GROUP;
    const cn_shade shade = cn_trainer_shade(t, g);
    cn_shade_grad grad;
    float after[CN_GROUP];
    for (uint32_t r = 0; r < CN_GROUP; r++) {
        const float *pixel = t->device.pixel + 4 * (first + r);
        memcpy(grad.pixel[r], pixel, sizeof grad.pixel[r]);
        after[r] = pixel[3];
    }
    cn_shade_pixels(&shade, after, saved, &grad, effect_grad, stats);
    for (uint32_t r = 0; r < CN_GROUP; r++) {
        float *d_pixel = t->device.d_pixel + 4 * (first + r);
        memcpy(d_pixel, grad.pixel[r], sizeof grad.pixel[r]);
        d_pixel[3] = grad.after[r];
    }
}

static void pixels(void *user, size_t slot, unsigned worker)
{
    cn_trainer *t = user;
    const cn_effect_grad effect_grad = grad_of(t, slot);
    cn_step_stats stats = { 0 };
    for (uint32_t g = (uint32_t)slot; g < t->batch.n_groups; g += CN_SLOTS) {
        memset(t->device.d_pixel + 4 * (size_t)g * CN_GROUP, 0, sizeof(float) * 4 * CN_GROUP);
        if (!cn_batch_has(&t->batch, g) || (!t->batch.group_samples[g] && !t->effects.pack.background.n)) continue;
        pixels_of_group(t, g, t->workers[worker].saved, &effect_grad, &stats);
    }
    float *sums = t->device.sums + slot * CN_STEP_SUM_KINDS;
    memset(sums, 0, CN_STEP_SUM_KINDS * sizeof *sums);
    sums[CN_SUM_ERROR] = (float)stats.squared_error;
    sums[CN_SUM_WEIGHED_ERROR] = (float)stats.weighed_error;
    sums[CN_SUM_WEIGHT] = (float)stats.weight;
    sums[CN_SUM_RAYS] = (float)stats.rays;
    sums[CN_SUM_BAD] = (float)stats.bad;
}

static void project(void *user, size_t slot, unsigned worker)
{
    (void)slot, (void)worker;
    cn_trainer *t = user;
    cn_train_effects_project(&t->effects, &t->parameters, cn_step_progress(cn_trainer_at(t)));
}

static bool has_columns_backward(const cn_effect_pack *pack)
{
    bool has = false;
    for (uint32_t i = 0; i < pack->field_in.n; i++)
        has = has || pack->on[pack->field_in.step[i]].effect->field_in_backward;
    return has;
}

/* ---- which of them ---- */

/* The effects that the shaders know, by name and shape. */
enum { VIEW_DEPENDENCE, APPEARANCE, SKY, EXPOSURE, TRANSIENT, POSE_REFINEMENT, STEREO_DEPTH, VIGNETTING, KNOWN };
static const struct {
    const char *name;
    uint32_t does, photo_params, shared_params;
} known[KNOWN] = {
    [VIEW_DEPENDENCE] = { "view_dependence", CN_DOES_DIRECTIONS, 0, 0 },
    [APPEARANCE] = { "appearance", CN_DOES_APPEARANCE, 16, 0 },
    [SKY] = { "sky", CN_DOES_SKY, 12, 1664 },
    [EXPOSURE] = { "exposure", CN_DOES_EXPOSURE, 1, 0 },
    [TRANSIENT] = { "transient", CN_DOES_TRANSIENT, 16, 6912 + 65536 },
    [POSE_REFINEMENT] = { "pose_refinement", CN_DOES_POSE, 12, 0 },
    [STEREO_DEPTH] = { "stereo_depth", 0, 0, 0 },
    [VIGNETTING] = { "vignetting", 0, 0, 0 },
};

/* KNOWN: no shader knows it. */
static uint32_t find(const cn_effect *effect)
{
    uint32_t k = 0;
    while (k < KNOWN && strcmp(known[k].name, effect->name) != 0)
        k++;
    const bool same = k < KNOWN && !effect->form && effect->photo_params == known[k].photo_params &&
                      effect->shared_params == known[k].shared_params;
    return same ? k : KNOWN;
}

/* An effect that is on, but does not take part yet, has no step in a stage. */
static bool takes_part(const cn_effect_pack *pack, uint32_t step)
{
    const cn_effect_stage *stages[] = { &pack->ray, &pack->field_in, &pack->background, &pack->pixel, &pack->loss };
    for (size_t s = 0; s < sizeof stages / sizeof *stages; s++)
        for (uint32_t i = 0; i < stages[s]->n; i++)
            if (stages[s]->step[i] == step) return true;
    return false;
}

/* Where the parameters of one effect are. */
static void place(cn_trainer *t, uint32_t which, const cn_effect_step *step)
{
    cn_step_settings *s = &t->device.step.settings;
    const uint32_t photo = (uint32_t)(t->parameters.photo_at + step->photo),
                   shared = (uint32_t)(t->parameters.shared_at + step->shared), constants = (uint32_t)step->constants;
    if (which == APPEARANCE) {
        s->at_appearance = photo;
        s->column_appearance = step->conditioning;
        if (cn_runs_differ(t->effects.run, t->effects.n_photos)) s->projects |= CN_DOES_DRAW_RUNS;
    } else if (which == SKY) {
        s->at_sky = photo;
        s->at_sky_head = shared;
    } else if (which == EXPOSURE) {
        s->at_exposure = photo;
        s->constants_exposure = constants;
        s->projects |= CN_DOES_CENTRE_GAINS;
    } else if (which == TRANSIENT) {
        s->at_transient = photo;
        s->at_transient_head = shared;
    } else if (which == POSE_REFINEMENT) {
        s->at_pose = photo;
        s->constants_pose = constants;
    }
}

static cn_step_hooks hooks_of(cn_trainer *t)
{
    const cn_effect_pack *pack = &t->effects.pack;
    return (cn_step_hooks){
        .columns = pack->field_in.n ? columns : NULL,
        .pixels = pixels,
        .columns_backward = has_columns_backward(pack) ? columns_backward : NULL,
        .rays_backward = pack->ray.n ? rays_backward : NULL,
        .project = pack->n_photo || pack->n_shared ? project : NULL,
        .user = t,
    };
}

bool cn_train_device_does(const cn_effect_pack *pack)
{
    for (uint32_t i = 0; i < pack->n_on; i++)
        if (find(pack->on[i].effect) == KNOWN) return false;
    return true;
}

void cn_train_device_effects(cn_trainer *t)
{
    const cn_effect_pack *pack = &t->effects.pack;
    cn_step_settings *s = &t->device.step.settings;
    const bool all_known = cn_train_device_does(pack);
    s->effects = s->projects = 0;
    for (uint32_t i = 0; i < pack->n_on; i++) {
        const uint32_t which = find(pack->on[i].effect);
        if (which == KNOWN) continue;
        if (takes_part(pack, i)) s->effects |= known[which].does;
        s->projects |= known[which].does;
        place(t, which, &pack->on[i]);
    }
    s->effects_by_processor = !all_known;
    if (!all_known) s->effects = s->projects = 0;
    t->device.step.hooks = all_known ? (cn_step_hooks){ 0 } : hooks_of(t);
    t->device.step.by_processor[CN_OP_MARCH] = !all_known && pack->ray.n; /* which moves the rays */
}
