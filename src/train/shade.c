#include "train/shade.h"

#include "effect/display.h"

#include <math.h>

#define LEAST_QUARTILE 1e-4f /* of three colours: 45 dB */

/* Turns the head's output into colours and keeps them. They are linear light, positive, without an upper limit. */
static void colours(uint32_t n_live, cn_worker *w)
{
    for (uint32_t i = 0; i < n_live; i++)
        for (size_t c = 0; c < 3; c++) {
            const float x = w->acts.out[((size_t)(i / CN_PANEL) * 4 + c) * CN_PANEL + i % CN_PANEL];
            w->colour[3 * (size_t)i + c] = cn_field_light(x);
        }
}

void cn_shade_forward(const cn_shade *s, uint32_t n_live, cn_worker *w)
{
    const uint32_t n_conditioning = s->field->conditioning, rows = s->field->colour_in;
    if (n_conditioning) {
        cn_effects_field_in(s->pack, &s->rays, &s->effects, w->conditioning, n_conditioning);
        for (uint32_t i = 0; i < n_live; i++) {
            float *at = w->acts.in + ((size_t)(i / CN_PANEL) * rows + s->field->geo_rows) * CN_PANEL + i % CN_PANEL;
            const float *row = w->conditioning + (size_t)w->live_ray[i] * n_conditioning;
            for (uint32_t c = 0; c < n_conditioning; c++)
                at[(size_t)c * CN_PANEL] = row[c];
        }
    }
    cn_shade_clear_tail(s->field, n_live, w);
    s->field->type->colour_pass(s->field, s->kernel, &s->params, &w->acts, (n_live + CN_PANEL - 1) / CN_PANEL);
    colours(n_live, w);
}

void cn_shade_composite(const cn_span *span, const cn_worker *w, float rgb[3])
{
    memset(rgb, 0, 3 * sizeof *rgb);
    for (uint32_t i = span->first; i < span->first + span->n; i++)
        for (size_t c = 0; c < 3; c++)
            rgb[c] += w->weight[i] * w->colour[3 * (size_t)i + c];
}

static void composite(const cn_shade *s, const cn_span *spans, const cn_worker *w, float (*pixel)[3], float *after)
{
    for (uint32_t r = 0; r < s->rays.n; r++) {
        after[r] = spans[r].after;
        cn_shade_composite(&spans[r], w, pixel[r]);
    }
}

/* The loss of Charbonnier et al. (1994): with the squared error e of a ray it is 2 b (sqrt(1 + e / b) - 1), whose
 * gradient is that of e times 1 / sqrt(1 + e / b). Squared errors make the field put up matter for what moves, shines
 * or stands a little otherwise in one photo: fog before the others. b is the third quartile of the group's errors, so
 * that no set of photos has to be tuned for (tests/bench/experiments.md, "Large errors"). */
static void weigh_large_errors(uint32_t n, const float *error, const float *scale, float *factor)
{
    float counted[CN_GROUP];
    for (uint32_t r = 0; r < n; r++)
        counted[r] = scale[r] > 0 ? error[r] : -1;
    const float b = fmaxf(cn_display_quartile(counted, n), LEAST_QUARTILE);
    for (uint32_t r = 0; r < n; r++)
        factor[r] /= sqrtf(1 + error[r] / b);
}

void cn_shade_pixels(const cn_shade *s, const float *after, float *saved, cn_shade_grad *grad,
                     const cn_effect_grad *effect_grad, cn_step_stats *stats)
{
    float error[CN_GROUP], scale[CN_GROUP], factor[CN_GROUP];
    float(*pixel)[3] = grad->pixel;
    cn_effects_shade(s->pack, &s->rays, &s->effects, after, &pixel[0][0], saved);
    for (uint32_t r = 0; r < s->rays.n; r++) {
        const float *target = s->target + 4 * (size_t)r;
        float d[3] = { 0, 0, 0 };
        error[r] = scale[r] = 0;
        factor[r] = 1;
        if (target[3] > 0) {
            const float e = cn_display_error(pixel[r], target, s->scale * target[3], d);
            if (isfinite(e) && isfinite(d[0] + d[1] + d[2])) {
                stats->squared_error += e;
                stats->rays++;
                error[r] = e;
                if (s->error) s->error[r] = e;
                scale[r] = s->scale * target[3];
            } else {
                d[0] = d[1] = d[2] = 0;
                stats->bad++;
            }
        }
        memcpy(pixel[r], d, sizeof d);
    }
    if (s->pack->loss.n) {
        const cn_effect_residuals residuals = { s->target, error, scale, after };
        cn_effects_loss(s->pack, &s->rays, &s->effects, &residuals, factor, saved);
    }
    for (uint32_t r = 0; r < s->rays.n; r++) {
        if (!(scale[r] > 0)) continue;
        const double weight = (double)factor[r];
        stats->weighed_error += weight * (double)error[r];
        stats->weight += weight;
    }
    if (s->charbonnier) weigh_large_errors(s->rays.n, error, scale, factor);
    for (uint32_t r = 0; r < s->rays.n; r++)
        for (int c = 0; c < 3; c++)
            pixel[r][c] *= factor[r];
    const cn_effect_shading shading = { after, saved, &pixel[0][0], grad->after };
    cn_effects_shade_backward(s->pack, &s->rays, &s->effects, &shading, effect_grad);
}

void cn_shade_loss(const cn_shade *s, const cn_span *spans, cn_worker *w, cn_shade_grad *grad,
                   const cn_effect_grad *effect_grad, cn_step_stats *stats)
{
    float after[CN_GROUP];
    composite(s, spans, w, grad->pixel, after);
    cn_shade_pixels(s, after, w->saved, grad, effect_grad, stats);
}

void cn_shade_colours_backward(const cn_span *span, const float d_pixel[3], cn_worker *w)
{
    for (uint32_t i = span->first; i < span->first + span->n; i++)
        for (size_t c = 0; c < 3; c++)
            w->d.out[((size_t)(i / CN_PANEL) * 4 + c) * CN_PANEL + i % CN_PANEL] =
                (w->weight[i] * d_pixel[c] + w->d_colour[3 * (size_t)i + c]) *
                cn_field_light_gradient(w->colour[3 * (size_t)i + c]);
}

void cn_shade_conditioning_backward(const cn_shade *s, uint32_t n_live, cn_worker *w, const cn_effect_grad *grad)
{
    if (!s->pack->n_photo) return;
    const uint32_t n_conditioning = s->field->conditioning, rows = s->field->colour_in;
    memset(w->d_conditioning, 0, sizeof(float) * CN_GROUP * n_conditioning);
    for (uint32_t i = 0; i < n_live; i++) {
        const float *at = w->d.in + ((size_t)(i / CN_PANEL) * rows + s->field->geo_rows) * CN_PANEL + i % CN_PANEL;
        float *row = w->d_conditioning + (size_t)w->live_ray[i] * n_conditioning;
        for (uint32_t c = 0; c < n_conditioning; c++)
            row[c] += at[(size_t)c * CN_PANEL];
    }
    cn_effects_field_in_backward(s->pack, &s->rays, &s->effects, w->d_conditioning, n_conditioning, grad);
}

void cn_shade_clear_tail(const cn_field *field, uint32_t n_live, cn_worker *w)
{
    for (size_t i = n_live; i % CN_PANEL; i++) {
        const size_t panel = i / CN_PANEL, lane = i % CN_PANEL;
        for (size_t r = 0; r < field->enc_rows; r++)
            w->acts.enc[(panel * field->enc_rows + r) * CN_PANEL + lane] = 0;
        for (size_t r = field->geo_rows; r < field->colour_in; r++)
            w->acts.in[(panel * field->colour_in + r) * CN_PANEL + lane] = 0;
        for (size_t r = 0; r < 4; r++)
            w->d.out[(panel * 4 + r) * CN_PANEL + lane] = 0;
        w->d_logit[i] = 0;
    }
}
