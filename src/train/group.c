/* A group of rays: densities, the live samples, their colours, the loss, and the backward pass. */
#include "train/composite.h"
#include "train/shade.h"
#include "train/trainer.h"

#include <math.h>
#include <string.h>

cn_shade cn_trainer_shade(const cn_trainer *t, uint32_t group)
{
    const cn_batch *b = &t->batch;
    cn_field_params params = cn_parameters_view(&t->parameters);
    params.prior = 1.0f / (float)(b->counts->kept_rays ? b->counts->kept_rays : 1);
    return (cn_shade){
        .kernel = t->kernel,
        .field = &t->parameters.field,
        .pack = &t->effects.pack,
        .params = params,
        .effects = cn_train_effects_state(&t->effects, t->kernel, &t->parameters),
        .rays = cn_train_effects_rays(b, group),
        .target = b->target + 4 * (size_t)group * CN_GROUP,
        .scale = 1.0f / (3.0f * (float)(b->counts->kept_rays ? b->counts->kept_rays : 1)),
        .charbonnier = true,
    };
}

/* Turns the gradients of the live samples' encodings into those of the rays, and passes these to the effects that
 * moved the rays. */
static void rays_backward(const cn_trainer *t, uint32_t group, const cn_shade *shade, uint32_t n_live, cn_worker *w,
                          const cn_effect_grad *grad)
{
    const cn_batch *b = &t->batch;
    const float *t_at = b->march_t + (size_t)group * CN_GROUP_CAP;
    float d_origin[CN_GROUP][3] = { { 0 } }, d_dir[CN_GROUP][3] = { { 0 } };
    const cn_box_units units = cn_box_units_of(&t->box);
    t->parameters.field.type->position_gradient(&t->parameters.field, shade->params.table,
                                                b->pos + b->group_panel[group] * 3 * CN_PANEL, w->d.enc, n_live,
                                                w->d_pos);
    for (uint32_t i = 0; i < n_live; i++) {
        const uint32_t r = w->live_ray[i];
        const cn_box_ray *ray = &b->rays[group * CN_GROUP + r].box_ray;
        const float at = t_at[w->live[i]];
        float x[3], d_x[3];
        for (int a = 0; a < 3; a++)
            x[a] = ray->origin[a] + at * ray->dir[a];
        cn_field_uncontract_gradient(x, w->d_pos[i], d_x);
        for (int a = 0; a < 3; a++) {
            d_origin[r][a] += d_x[a] * units.from_mean[a];
            d_dir[r][a] += d_x[a] * at * units.from_m[a];
        }
    }
    cn_effects_ray_backward(&t->effects.pack, &shade->rays, &shade->effects, d_origin, d_dir, grad);
}

/* Log-distances of a ray's live samples; returns their weighted mean. */
static float log_distances(const cn_span *span, const float *t_at, cn_worker *w)
{
    float mean = 0;
    for (uint32_t i = span->first; i < span->first + span->n; i++) {
        w->log_distance[i] = logf(t_at[w->live[i]]);
        mean += w->weight[i] * w->log_distance[i];
    }
    return span->total > 0 ? mean / span->total : mean;
}

/* Gradients with respect to the weights of one ray's live samples. Returns the gradient with respect to the
 * transmittance at its end. */
static float ray_losses(const cn_trainer *t, uint32_t group, const cn_span *span, cn_loss_ray *ray, float d_after,
                        cn_worker *w)
{
    const cn_batch *b = &t->batch;
    const uint32_t first = span->first;
    float shown[3];
    ray->n = span->n;
    ray->weight = w->weight + first;
    ray->colour = w->colour + 3 * (size_t)first;
    ray->log_distance = w->log_distance + first;
    ray->after = span->after;
    cn_shade_composite(span, w, shown);
    ray->brightest = fmaxf(shown[0], fmaxf(shown[1], shown[2]));
    ray->single_view = NULL;
    if (t->effects.pack.single_view) {
        cn_support_mark(&t->support, t->support.visit + b->group_panel[group] * CN_PANEL, t->step, span, w);
        ray->single_view = w->single_view + first;
    }
    cn_loss_grad grad = { w->d_weight + first, w->d_colour + 3 * (size_t)first, d_after };
    cn_losses_add(&t->losses, ray, &grad);
    return grad.after;
}

/* Depths that nobody measured lead at first, then the photos do. Those by stereo lead for half of the schedule only:
 * they know nothing that the photos do not tell. A network's depths know more, so they keep half of their weight. But
 * single pixels of theirs are wrong, so a ray is drawn less to exactly its own.
 *
 * Tuned on six photos of a synthetic city with maps that have noise of up to 10 % (tests/flow/depth.sh), three seeds:
 * median error of depth 0.067 without maps, 0.036 with a deviation of 0.1 and a weight that falls to 0, 0.034 with a
 * deviation of 0.03, 0.032 with half of the weight kept as well; 0.031 since points at edges do not count (depth.c). */
enum { STEREO, NETWORK };
static const struct {
    double falls_by;
    float deviation;
} cue[] = { [STEREO] = { 2, 0.1f }, [NETWORK] = { 0.5, 0.03f } };

float cn_trainer_cue_weight(const cn_trainer *t)
{
    const double progress = cn_step_progress(cn_trainer_at(t));
    return (float)fmax(0, 1 - cue[t->sampler.stereo ? STEREO : NETWORK].falls_by * progress);
}

float cn_trainer_cue_deviation(const cn_trainer *t)
{
    return cue[t->sampler.stereo ? STEREO : NETWORK].deviation;
}

#define MOSTLY_OPAQUE 0.5f
#define SAME_SURFACE 0.6931472f /* log 2: depths of neighbours that differ by more are those of two surfaces */

/* The plane through the neighbour's mean depth. mean[CN_GROUP]: of the rays' log-distances. */
static void take_plane(const cn_batch *b, uint32_t group, uint32_t r, const cn_span *spans, const float *mean,
                       cn_loss_ray *ray)
{
    const uint32_t i = group * CN_GROUP + r, other = r ^ 1;
    ray->has_plane = b->plane_width && b->plane_width[i] > 0 && spans[r].total > MOSTLY_OPAQUE &&
                     spans[other].total > MOSTLY_OPAQUE && fabsf(mean[r] - mean[other]) < SAME_SURFACE;
    if (!ray->has_plane) return;
    ray->log_plane = mean[other] + b->plane_log[i];
    ray->plane_width = b->plane_width[i];
}

/* Gradients of the density logits and of the colour head's output, from those of the pixels. */
static void samples_backward(cn_trainer *t, uint32_t group, const cn_shade *shade, const cn_span *spans,
                             const cn_shade_grad *grad, cn_worker *w)
{
    const cn_batch *b = &t->batch;
    const bool background = t->effects.pack.background.n > 0;
    const float late = cn_trainer_late(t);
    cn_loss_ray ray = { .scale = 1 / (float)(b->counts->kept_rays ? b->counts->kept_rays : 1),
                        .cue_weight = cn_trainer_cue_weight(t),
                        .cue_deviation = cn_trainer_cue_deviation(t),
                        .prior_weight = cn_monitor_prior_weight(&t->monitor) };
    float mean[CN_GROUP];
    for (uint32_t r = 0; r < CN_GROUP; r++)
        mean[r] = log_distances(&spans[r], b->march_t + (size_t)group * CN_GROUP_CAP, w);
    for (uint32_t r = 0; r < CN_GROUP; r++) {
        const uint32_t i = group * CN_GROUP + r;
        ray.mean = mean[r];
        take_plane(b, group, r, spans, mean, &ray);
        ray.counts = shade->target[4 * (size_t)r + 3] > 0;
        ray.covered = cn_effects_cover(&t->effects.pack, shade->rays.dir + 3 * (size_t)r);
        ray.has_depth = b->depth_m[i] > 0;
        ray.log_depth = ray.has_depth ? logf(late * b->depth_m[i]) : 0;
        ray.has_measured = b->measured_m && b->measured_m[i] > 0;
        ray.log_measured = ray.has_measured ? logf(late * b->measured_m[i]) : 0;
        ray.d_pixel = grad->pixel[r];
        cn_composite_backward(&spans[r], ray_losses(t, group, &spans[r], &ray, grad->after[r], w), w);
        if (ray.counts) cn_reactivation_note(&t->reactivation, b, i, spans[r].after, background);
        cn_shade_colours_backward(&spans[r], grad->pixel[r], w);
    }
}

/* The way back through the field, whose encodings the gradients then replace. */
static void field_backward(cn_trainer *t, uint32_t group, const cn_shade *shade, uint32_t n_live, cn_worker *w,
                           float *grad)
{
    cn_batch *b = &t->batch;
    const size_t panels = cn_batch_panels(n_live), stride = (size_t)shade->field->enc_rows * CN_PANEL;
    for (size_t i = 0; i < panels; i++)
        memset(w->d.out + (i * 4 + 3) * CN_PANEL, 0, CN_PANEL * sizeof(float));
    cn_field_params params = shade->params;
    params.visible = w->weight;
    shade->field->type->backward(shade->field, t->kernel, &params, &w->acts,
                                 &(cn_field_gradient){ &w->d, w->d_logit, grad }, panels);
    memcpy(b->enc + b->group_panel[group] * stride, w->d.enc, panels * stride * sizeof *b->enc);
    b->group_live[group] = n_live;
}

enum { DISTIL_OTHERS = 4 }; /* every so many-th of the samples without weight is compared too */

/* The same for a group that learns from the teacher. The densities that decide which samples are live are the
 * teacher's; the photos only tell how far it is. The effects do not change. */
static void distil_group(cn_trainer *t, uint32_t group, cn_worker *w, float *grad, cn_step_stats *stats)
{
    cn_batch *b = &t->batch;
    const cn_field *field = &t->parameters.field;
    cn_shade shade = cn_trainer_shade(t, group);
    const cn_effect_grad effect_grad = { grad + t->parameters.photo_at, grad + t->parameters.shared_at };
    const unsigned worker = (unsigned)(w - t->workers);
    const size_t first = b->group_panel[group], panels = cn_batch_panels(b->group_samples[group]);
    float *pos = b->pos + first * 3 * CN_PANEL;
    cn_span spans[CN_GROUP];
    const cn_composite_samples samples = {
        .n_rays = CN_GROUP,
        .of_ray = b->ray_samples + group * CN_GROUP,
        .length = b->length + first * CN_PANEL,
        .enc = b->enc + first * field->enc_rows * CN_PANEL,
        .pos = pos,
        .others = DISTIL_OTHERS,
        .seen = b->visit_seen + first * CN_PANEL,
    };
    shade.params.prior = 0;
    cn_distil_logits(&t->distil, t->kernel, worker, pos, panels, w->logit);
    cn_batch_note_cells(b, group);
    const uint32_t n_live = cn_composite_gather(field, &samples, w, spans);
    cn_shade_clear_tail(field, n_live, w);
    field->type->density_pass(field, t->kernel, &shade.params, &w->acts, cn_batch_panels(n_live));
    cn_shade_forward(&shade, n_live, w);
    cn_shade_grad unused;
    cn_shade_loss(&shade, spans, w, &unused, &effect_grad, stats);
    cn_distil_compare(field, w, n_live, samples.length,
                      cn_distil_colours(&t->distil, t->kernel, worker, pos, n_live, w), shade.scale);
    field_backward(t, group, &shade, n_live, w, grad);
    memset(grad + t->parameters.photo_at, 0, (t->parameters.n - t->parameters.photo_at) * sizeof *grad);
    stats->live += n_live;
}

void cn_trainer_group(cn_trainer *t, uint32_t group, cn_worker *w, float *grad, cn_step_stats *stats)
{
    if (cn_distil_is_on(&t->distil, cn_step_progress(cn_trainer_at(t)))) {
        distil_group(t, group, w, grad, stats);
        return;
    }
    cn_batch *b = &t->batch;
    const cn_field *field = &t->parameters.field;
    const cn_shade shade = cn_trainer_shade(t, group);
    const cn_effect_grad effect_grad = { grad + t->parameters.photo_at, grad + t->parameters.shared_at };
    const size_t first = b->group_panel[group], panels = cn_batch_panels(b->group_samples[group]);
    float *enc = b->enc + first * field->enc_rows * CN_PANEL;

    /* Densities of all samples; then the live samples are moved together. */
    cn_field_acts all = w->acts;
    all.enc = enc;
    field->type->logits(field, t->kernel, &shade.params, &all, panels, w->logit);
    cn_batch_note_cells(b, group);
    if (t->support.visit) cn_support_note(&t->support, b, group);
    cn_span spans[CN_GROUP];
    const cn_composite_samples samples = {
        .n_rays = CN_GROUP,
        .of_ray = b->ray_samples + group * CN_GROUP,
        .length = b->length + first * CN_PANEL,
        .enc = enc,
        .pos = b->pos + first * 3 * CN_PANEL,
        .seen = b->visit_seen + first * CN_PANEL,
    };
    const uint32_t n_live = cn_composite_gather(field, &samples, w, spans);

    /* Forward. */
    cn_shade_clear_tail(field, n_live, w);
    field->type->density_pass(field, t->kernel, &shade.params, &w->acts, cn_batch_panels(n_live));
    cn_shade_forward(&shade, n_live, w);

    /* Loss, and backward. */
    cn_shade_grad shade_grad;
    cn_shade_loss(&shade, spans, w, &shade_grad, &effect_grad, stats);
    samples_backward(t, group, &shade, spans, &shade_grad, w);
    field_backward(t, group, &shade, n_live, w, grad);
    cn_shade_conditioning_backward(&shade, n_live, w, &effect_grad);
    if (t->effects.pack.ray.n) rays_backward(t, group, &shade, n_live, w, &effect_grad);
    stats->live += n_live;
}
