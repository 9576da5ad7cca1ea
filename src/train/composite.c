/* A group of rays: densities, transmittance, the live samples, their colours, the loss, and all of it backward.
 *
 * With sigma = exp(logit) every gradient of a sample is proportional to its weight, so samples with a negligible weight (empty, or behind a surface)
 * are left out of the colour head and of the backward pass: after the first minutes that is most of them. */
#include "train/trainer.h"

#include "conurb/colour.h"

#include <math.h>

#define MIN_WEIGHT 1e-4f        /* of a live sample */
#define MIN_TRANSMITTANCE 1e-4f /* a ray ends below it */
#define MAX_LOGIT 15.0f
#define SPREAD_LOSS 0.01f       /* weight of the variance of log-distance of a ray's samples: fog becomes surface */

/* Where a ray's live samples lie in the worker's arrays. */
typedef struct span { uint32_t first, n; float total; } span;

/* Finds the live samples of one ray from the logits. */
static span find_live(const float *logit, const float *length, uint32_t first, uint32_t n, uint32_t ray, uint32_t at,
                      cn_worker *w, float *seen)
{
    span s = {at, 0, 0};
    float transmittance = 1;
    for (uint32_t i = first; i < first + n; i++) {
        seen[i] = 0;
        if (!(transmittance > MIN_TRANSMITTANCE)) continue;
        const float sigma = expf(fminf(logit[i], MAX_LOGIT)), tau = sigma * length[i];
        seen[i] = cn_occupancy_seen(transmittance, sigma);
        const float after = transmittance * expf(-tau), weight = transmittance - after;
        transmittance = after;
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
    for (size_t r = 0; r < rows; r++) a[r * CN_PANEL] = b[r * CN_PANEL];
}

static float encode_srgb(float x, float *slope)
{
    if (x <= 0.0031308f) {
        *slope = 12.92f;
        return 12.92f * x;
    }
    const float y = powf(x, 1 / 2.4f);
    *slope = 1.055f / 2.4f * y / x;
    return 1.055f * y - 0.055f;
}

static void to_srgb(const float acescg[3], float srgb[3])
{
    for (int i = 0; i < 3; i++)
        srgb[i] = (float)cn_srgb_from_acescg[3 * i] * acescg[0] + (float)cn_srgb_from_acescg[3 * i + 1] * acescg[1] +
                  (float)cn_srgb_from_acescg[3 * i + 2] * acescg[2];
}

/* Squared error of display-encoded sRGB; d_rgb is its gradient, scaled, with respect to the linear ACEScg prediction. */
static float loss_of(const float rgb[3], const float target[3], float scale, float d_rgb[3])
{
    float a[3], b[3], error = 0;
    to_srgb(rgb, a);
    to_srgb(target, b);
    d_rgb[0] = d_rgb[1] = d_rgb[2] = 0;
    for (int i = 0; i < 3; i++) {
        float slope, unused;
        const float e = encode_srgb(a[i], &slope) - encode_srgb(b[i], &unused);
        error += e * e;
        for (int c = 0; c < 3; c++) d_rgb[c] += 2 * scale * e * slope * (float)cn_srgb_from_acescg[3 * i + c];
    }
    return error;
}

/* Colours, loss and pixel gradients of the group's rays: pixel[ray][3] becomes the gradient of the composited colour. */
static void pixels_and_loss(cn_trainer *t, uint32_t group, const span *spans, cn_worker *w, float pixel[CN_GROUP][3], float *grad,
                            cn_step_stats *stats)
{
    const uint32_t first = group * CN_GROUP;
    for (uint32_t r = 0; r < CN_GROUP; r++) {
        for (int c = 0; c < 3; c++) pixel[r][c] = 0;
        for (uint32_t i = spans[r].first; i < spans[r].first + spans[r].n; i++)
            for (int c = 0; c < 3; c++) pixel[r][c] += w->weight[i] * w->colour[3 * (size_t)i + c];
    }
    const cn_effect_rays rays = {CN_GROUP, t->dirs + 3 * (size_t)first, t->ray_photo + first};
    const float *params = t->flat.value + t->field.n_weights;
    cn_effects_pixel(&t->pack, &rays, t->constants, params, &pixel[0][0], w->trail);
    const float scale = 1.0f / (3.0f * (float)(t->kept_rays ? t->kept_rays : 1));
    for (uint32_t r = 0; r < CN_GROUP; r++) {
        const float *target = t->target + 4 * (size_t)(first + r);
        float d[3] = {0, 0, 0};
        if (t->ray_samples[first + r] && target[3] > 0) {
            const float error = loss_of(pixel[r], target, scale * target[3], d);
            if (isfinite(error) && isfinite(d[0] + d[1] + d[2])) {
                stats->squared_error += error;
                stats->rays++;
            } else {
                d[0] = d[1] = d[2] = 0;
                stats->bad++;
            }
        }
        memcpy(pixel[r], d, sizeof d);
    }
    cn_effects_pixel_backward(&t->pack, &rays, t->constants, params, w->trail, &pixel[0][0], grad + t->field.n_weights);
}

/* Gradients of log colours and density logits of one ray's live samples, back to front. */
static void ray_backward(const span *s, const float d_pixel[3], const float *t_at, float spread_scale, cn_worker *w)
{
    float mean = 0, sum_behind = 0;
    for (uint32_t i = s->first; i < s->first + s->n; i++) mean += w->weight[i] * logf(t_at[w->live[i]]);
    if (s->total > 0) mean /= s->total;
    for (uint32_t i = s->first + s->n; i-- > s->first;) {
        const float *colour = w->colour + 3 * (size_t)i;
        const float off = logf(t_at[w->live[i]]) - mean;
        const float d_weight = d_pixel[0] * colour[0] + d_pixel[1] * colour[1] + d_pixel[2] * colour[2] + spread_scale * off * off;
        const size_t panel = i / CN_PANEL, lane = i % CN_PANEL;
        for (size_t c = 0; c < 3; c++)
            w->d.out[(panel * 4 + c) * CN_PANEL + lane] = w->weight[i] * d_pixel[c] * colour[c];
        const float d_tau = w->behind[i] * d_weight - sum_behind;
        w->d_logit[i] = d_tau * w->tau[i];
        sum_behind += w->weight[i] * d_weight;
    }
}

/* The effects' columns, a row a ray, spread over the live samples (forward) or summed over them (backward). */
static void columns_forward(cn_trainer *t, uint32_t group, uint32_t n_live, cn_worker *w)
{
    const uint32_t columns = t->field.columns, first = group * CN_GROUP;
    if (!columns) return;
    const cn_effect_rays rays = {CN_GROUP, t->dirs + 3 * (size_t)first, t->ray_photo + first};
    cn_effects_field_in(&t->pack, &rays, t->constants, t->flat.value + t->field.n_weights, w->columns, columns);
    for (uint32_t i = 0; i < n_live; i++) {
        float *at = w->acts.in + ((size_t)(i / CN_PANEL) * t->field.colour_in + CN_GEO) * CN_PANEL + i % CN_PANEL;
        const float *row = w->columns + (size_t)w->live_ray[i] * columns;
        for (uint32_t c = 0; c < columns; c++) at[(size_t)c * CN_PANEL] = row[c];
    }
}

static void columns_backward(cn_trainer *t, uint32_t group, uint32_t n_live, cn_worker *w, float *grad)
{
    if (!t->pack.n_params) return;
    const uint32_t columns = t->field.columns, first = group * CN_GROUP;
    memset(w->d_columns, 0, sizeof(float) * CN_GROUP * columns);
    for (uint32_t i = 0; i < n_live; i++) {
        const float *at = w->d.in + ((size_t)(i / CN_PANEL) * t->field.colour_in + CN_GEO) * CN_PANEL + i % CN_PANEL;
        float *row = w->d_columns + (size_t)w->live_ray[i] * columns;
        for (uint32_t c = 0; c < columns; c++) row[c] += at[(size_t)c * CN_PANEL];
    }
    const cn_effect_rays rays = {CN_GROUP, t->dirs + 3 * (size_t)first, t->ray_photo + first};
    cn_effects_field_in_backward(&t->pack, &rays, t->constants, t->flat.value + t->field.n_weights, w->d_columns, columns,
                                 grad + t->field.n_weights);
}

/* Zeroes what the last panel holds past the last live sample. */
static void clear_tail(const cn_trainer *t, uint32_t n_live, cn_worker *w)
{
    for (size_t i = n_live; i % CN_PANEL; i++) {
        const size_t panel = i / CN_PANEL, lane = i % CN_PANEL;
        for (size_t r = 0; r < t->field.enc_rows; r++) w->acts.enc[(panel * t->field.enc_rows + r) * CN_PANEL + lane] = 0;
        for (size_t r = CN_GEO; r < t->field.colour_in; r++) w->acts.in[(panel * t->field.colour_in + r) * CN_PANEL + lane] = 0;
        for (size_t r = 0; r < 4; r++) w->d.out[(panel * 4 + r) * CN_PANEL + lane] = 0;
        w->d_logit[i] = 0;
    }
}

static uint32_t gather_live(cn_trainer *t, uint32_t group, cn_worker *w, span spans[CN_GROUP])
{
    const size_t panel = t->group_panel[group], enc_rows = t->field.enc_rows;
    const float *length = t->length + panel * CN_PANEL;
    uint32_t at = 0, first = 0;
    for (uint32_t r = 0; r < CN_GROUP; r++) {
        const uint32_t n = t->ray_samples[group * CN_GROUP + r];
        spans[r] = find_live(w->logit, length, first, n, r, at, w, t->visit_seen + panel * CN_PANEL);
        at += spans[r].n;
        first += n;
    }
    float *enc = t->enc + panel * enc_rows * CN_PANEL, *pos = t->pos + panel * 3 * CN_PANEL;
    for (uint32_t i = 0; i < at; i++) {
        copy_lane(w->acts.enc, i, enc, w->live[i], enc_rows);
        copy_lane(pos, i, pos, w->live[i], 3); /* forward in place: i <= live[i] */
    }
    return at;
}

/* Which cells the samples lie in, before they move together. */
static void note_cells(cn_trainer *t, uint32_t group)
{
    const size_t first = t->group_panel[group] * CN_PANEL;
    for (uint32_t i = 0; i < t->group_samples[group]; i++) {
        const float *pos = t->pos + (first + i) / CN_PANEL * (3 * CN_PANEL) + (first + i) % CN_PANEL;
        t->visit_cell[first + i] = cn_occupancy_cell(pos[0], pos[CN_PANEL], pos[2 * CN_PANEL]);
    }
}

/* Log colours to colours, kept beside: linear light, always positive, any range. */
static void colours(uint32_t n_live, cn_worker *w)
{
    for (uint32_t i = 0; i < n_live; i++)
        for (size_t c = 0; c < 3; c++) {
            const float x = w->acts.out[((size_t)(i / CN_PANEL) * 4 + c) * CN_PANEL + i % CN_PANEL];
            w->colour[3 * (size_t)i + c] = expf(fminf(x, 8.0f));
        }
}

void cn_trainer_group(cn_trainer *t, uint32_t group, cn_worker *w, float *grad, cn_step_stats *stats)
{
    const cn_field_params params = {(const uint32_t *)(const void *)t->table_copy, t->flat.value, t->transposed};
    const size_t panels = (t->group_samples[group] + CN_PANEL - 1) / CN_PANEL;
    const size_t enc_stride = (size_t)t->field.enc_rows * CN_PANEL;
    float *enc = t->enc + t->group_panel[group] * enc_stride;

    /* Densities of all samples, then the live ones move together. */
    cn_field_logits(&t->field, t->kernel, &params, enc, panels, w->acts.hidden, w->acts.in, w->logit);
    note_cells(t, group);
    span spans[CN_GROUP];
    const uint32_t n_live = gather_live(t, group, w, spans);
    const size_t live_panels = (n_live + CN_PANEL - 1) / CN_PANEL;

    /* Forward. */
    clear_tail(t, n_live, w);
    cn_field_density(&t->field, t->kernel, &params, &w->acts, live_panels);
    columns_forward(t, group, n_live, w);
    clear_tail(t, n_live, w);
    cn_field_colour(&t->field, t->kernel, &params, &w->acts, live_panels);
    colours(n_live, w);

    /* Loss, and backward. */
    float pixel[CN_GROUP][3];
    pixels_and_loss(t, group, spans, w, pixel, grad, stats);
    const float *t_at = t->march_t + (size_t)group * CN_GROUP_CAP;
    const float spread_scale = SPREAD_LOSS / (float)(t->kept_rays ? t->kept_rays : 1);
    for (uint32_t r = 0; r < CN_GROUP; r++) ray_backward(&spans[r], pixel[r], t_at, spread_scale, w);
    for (size_t i = 0; i < (size_t)live_panels; i++) memset(w->d.out + (i * 4 + 3) * CN_PANEL, 0, CN_PANEL * sizeof(float));
    cn_field_backward(&t->field, t->kernel, &params, &w->acts, &w->d, w->d_logit, live_panels, grad);
    columns_backward(t, group, n_live, w, grad);
    memcpy(enc, w->d.enc, live_panels * enc_stride * sizeof *enc);
    t->group_live[group] = n_live;
    stats->live += n_live;
}
