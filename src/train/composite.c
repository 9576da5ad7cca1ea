/* A group of rays: densities, transmittance, the live samples, their colours, the loss, and all of it backward.
 *
 * With sigma = exp(logit) every gradient of a sample is proportional to its weight, so samples with a negligible weight
 * (empty, or behind a surface) are left out of the colour head and of the backward pass: after the first minutes that
 * is most of them. */
#include "train/trainer.h"

#include <math.h>

#define MIN_WEIGHT 1e-4f        /* of a live sample */
#define MIN_TRANSMITTANCE 1e-4f /* a ray ends below it */
#define MAX_LOGIT 15.0f
#define OPEN_LOSS                                                                                                      \
    0.01f /* of a ray that goes on for ever where no background takes it, times doubt: else bright glass stands for    \
             matter */

/* Finds the live samples of one ray from the logits. */
static cn_span find_live(const float *logit, const float *length, uint32_t first, uint32_t n, uint32_t ray, uint32_t at,
                         cn_worker *w, float *seen)
{
    cn_span s = { at, 0, 0, 1 };
    for (uint32_t i = first; i < first + n; i++) {
        if (seen) seen[i] = 0;
        if (!(s.after > MIN_TRANSMITTANCE)) continue;
        const float sigma = expf(fminf(logit[i], MAX_LOGIT)), tau = sigma * length[i];
        if (seen) seen[i] = cn_occupancy_seen(s.after, sigma);
        const float after = s.after * expf(-tau), weight = s.after - after;
        s.after = after;
        if (!(weight > MIN_WEIGHT)) continue;
        w->weight[at] = weight;
        w->behind[at] = after;
        w->tau[at] = tau;
        w->live[at] = i;
        w->live_ray[at] = ray;
        s.total += weight;
        at++;
    }
    s.n = at - s.first;
    return s;
}

/* Copies column `from` of a run of panels to column `to`: rows are CN_PANEL apart. */
static void copy_lane(float *to_panels, size_t to, const float *from_panels, size_t from, size_t rows)
{
    float *a = to_panels + to / CN_PANEL * rows * CN_PANEL + to % CN_PANEL;
    const float *b = from_panels + from / CN_PANEL * rows * CN_PANEL + from % CN_PANEL;
    for (size_t r = 0; r < rows; r++)
        a[r * CN_PANEL] = b[r * CN_PANEL];
}

uint32_t cn_composite_gather(const cn_field *field, const uint32_t *ray_samples, uint32_t n_rays, const float *length,
                             float *enc, float *pos, float *seen, cn_worker *w, cn_span *spans)
{
    uint32_t at = 0, first = 0;
    for (uint32_t r = 0; r < n_rays; r++) {
        spans[r] = find_live(w->logit, length, first, ray_samples[r], r, at, w, seen);
        at += spans[r].n;
        first += ray_samples[r];
    }
    for (uint32_t i = 0; i < at; i++) {
        copy_lane(w->acts.enc, i, enc, w->live[i], field->enc_rows);
        copy_lane(pos, i, pos, w->live[i], 3); /* forward in place: i <= live[i] */
    }
    return at;
}

/* Back to front. What lies behind the last sample counts as one more, of weight `after`. */
void cn_composite_backward(const cn_span *s, const float d_pixel[3], float d_after, const float *t_at, float tie,
                           float scale, float doubt, cn_worker *w)
{
    if (tie > 0) d_after += scale * CN_TIE_LOSS; /* something is there: the ray does not go on */
    float mean = 0, sum_behind = s->after * d_after;
    for (uint32_t i = s->first; i < s->first + s->n; i++)
        mean += w->weight[i] * logf(t_at[w->live[i]]);
    if (s->total > 0) mean /= s->total;
    if (tie > 0) mean = logf(tie);
    const float squared = scale * (tie > 0 ? CN_TIE_LOSS : CN_SPREAD_LOSS);
    const float linear = scale * (tie > 0 ? CN_TIE_BLUR_LOSS : doubt * CN_BLUR_LOSS);
    for (uint32_t i = s->first + s->n; i-- > s->first;) {
        const float *colour = w->colour + 3 * (size_t)i;
        const float off = logf(t_at[w->live[i]]) - mean;
        const float d_weight = d_pixel[0] * colour[0] + d_pixel[1] * colour[1] + d_pixel[2] * colour[2] +
                               squared * off * off + linear * fabsf(off);
        const float d_tau = w->behind[i] * d_weight - sum_behind;
        w->d_logit[i] = d_tau * w->tau[i];
        sum_behind += w->weight[i] * d_weight;
    }
}

/* Which cells the samples lie in, before they move together. */
static void note_cells(cn_trainer *t, uint32_t group)
{
    const size_t first = t->group_panel[group] * CN_PANEL;
    for (uint32_t i = 0; i < t->group_samples[group]; i++) {
        const float *pos = t->pos + (first + i) / CN_PANEL * (3 * CN_PANEL) + (first + i) % CN_PANEL;
        t->visit_cell[first + i] = cn_occupancy_cell(pos[0], pos[CN_PANEL], pos[2 * CN_PANEL]);
    }
    if (t->visit_witness) cn_witness_note(t, group);
}

static cn_shade shade_of(const cn_trainer *t, uint32_t group)
{
    const size_t first = (size_t)group * CN_GROUP;
    return (cn_shade){
        .kernel = t->kernel,
        .field = &t->field,
        .pack = &t->pack,
        .params = { (const uint32_t *)(const void *)t->table, t->flat.value, t->transposed },
        .effects = { t->kernel, t->constants, t->flat.value + t->photo_at, t->flat.value + t->shared_at, t->derived },
        .rays = { CN_GROUP, t->dirs + 3 * first, t->uv ? t->uv + 2 * first : NULL, t->ray_photo + first },
        .target = t->target + 4 * first,
        .scale = 1.0f / (3.0f * (float)(t->kept_rays ? t->kept_rays : 1)),
    };
}

/* From the gradients of the live samples' encodings to those of the rays, and on to the effects that moved them. */
static void rays_backward(const cn_trainer *t, uint32_t group, const cn_shade *shade, uint32_t n_live, cn_worker *w,
                          const cn_effect_grad *grad)
{
    const float *t_at = t->march_t + (size_t)group * CN_GROUP_CAP;
    float d_origin[CN_GROUP][3] = { { 0 } }, d_dir[CN_GROUP][3] = { { 0 } }, unit[3];
    for (int a = 0; a < 3; a++)
        unit[a] = 1 / ((float)t->box.half_extent[a] * t->inv_extent);
    cn_field_slope(&t->field, shade->params.table, t->pos + t->group_panel[group] * 3 * CN_PANEL, w->d.enc, n_live,
                   w->d_pos);
    for (uint32_t i = 0; i < n_live; i++) {
        const uint32_t r = w->live_ray[i];
        const cn_box_ray *ray = &t->rays[group * CN_GROUP + r].box_ray;
        const float at = t_at[w->live[i]];
        float x[3], d_x[3];
        for (int a = 0; a < 3; a++)
            x[a] = ray->origin[a] + at * ray->dir[a];
        cn_field_uncontract_slope(x, w->d_pos[i], d_x);
        for (int a = 0; a < 3; a++) {
            d_origin[r][a] += d_x[a] * unit[a];
            d_dir[r][a] += d_x[a] * at / (float)t->box.half_extent[a];
        }
    }
    cn_effects_ray_backward(&t->pack, &shade->rays, &shade->effects, d_origin, d_dir, grad);
}

void cn_trainer_group(cn_trainer *t, uint32_t group, cn_worker *w, float *grad, cn_step_stats *stats)
{
    const cn_shade shade = shade_of(t, group);
    const cn_effect_grad effect_grad = { grad + t->photo_at, grad + t->shared_at };
    const size_t first = t->group_panel[group], panels = (t->group_samples[group] + CN_PANEL - 1) / CN_PANEL;
    const size_t enc_stride = (size_t)t->field.enc_rows * CN_PANEL;
    float *enc = t->enc + first * enc_stride;

    /* Densities of all samples, then the live ones move together. */
    cn_field_logits(&t->field, t->kernel, &shade.params, enc, panels, w->acts.hidden, w->acts.in, w->logit);
    note_cells(t, group);
    cn_span spans[CN_GROUP];
    const uint32_t n_live =
        cn_composite_gather(&t->field, t->ray_samples + group * CN_GROUP, CN_GROUP, t->length + first * CN_PANEL, enc,
                            t->pos + first * 3 * CN_PANEL, t->visit_seen + first * CN_PANEL, w, spans);
    const size_t live_panels = (n_live + CN_PANEL - 1) / CN_PANEL;

    /* Forward. */
    cn_shade_clear_tail(&t->field, n_live, w);
    cn_field_density(&t->field, t->kernel, &shade.params, &w->acts, live_panels);
    cn_shade_forward(&shade, n_live, w);

    /* Loss, and backward. */
    float pixel[CN_GROUP][3], d_after[CN_GROUP];
    cn_shade_loss(&shade, spans, w, pixel, d_after, &effect_grad, stats);
    const float *t_at = t->march_t + (size_t)group * CN_GROUP_CAP;
    const float scale = 1 / (float)(t->kept_rays ? t->kept_rays : 1);
    /* The first sample behind a surface lies half a step behind it on average: there a sparse point is looked for. */
    const float late = (float)(1 + 0.5 * t->march_step), doubt = cn_guard_doubt(t);
    for (uint32_t r = 0; r < CN_GROUP; r++) {
        if (!t->pack.background.n && shade.target[4 * (size_t)r + 3] > 0) d_after[r] += scale * doubt * OPEN_LOSS;
        cn_composite_backward(&spans[r], pixel[r], d_after[r], t_at, late * t->ray_tie[group * CN_GROUP + r], scale,
                              doubt, w);
        if (shade.target[4 * (size_t)r + 3] > 0) cn_reopen_note(t, group * CN_GROUP + r, spans[r].after);
        if (t->pack.lone) cn_witness_backward(t, group, &spans[r], scale, w);
        cn_shade_colours_backward(&spans[r], pixel[r], w);
    }
    for (size_t i = 0; i < live_panels; i++)
        memset(w->d.out + (i * 4 + 3) * CN_PANEL, 0, CN_PANEL * sizeof(float));
    cn_field_backward(&t->field, t->kernel, &shade.params, &w->acts, &w->d, w->d_logit, live_panels, grad);
    cn_shade_columns_backward(&shade, n_live, w, &effect_grad);
    if (t->pack.ray.n) rays_backward(t, group, &shade, n_live, w, &effect_grad);
    memcpy(enc, w->d.enc, live_panels * enc_stride * sizeof *enc);
    t->group_live[group] = n_live;
    stats->live += n_live;
}
