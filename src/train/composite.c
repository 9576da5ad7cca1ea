/* With sigma = exp(logit) every gradient of a sample is proportional to its weight. Samples with a negligible weight
 * (empty, or behind a surface) are therefore left out of the colour head and of the backward pass. After the first
 * minutes that is most of them. */
#include "train/composite.h"

#include "field/occupancy.h"

#include <math.h>

#define MIN_WEIGHT 1e-4f        /* of a live sample */
#define MIN_TRANSMITTANCE 1e-4f /* a ray ends below it */

/* Finds the live samples of one ray from the logits. The ray's samples begin at `first`; the live ones go to the
 * worker's arrays from `at` on. */
static cn_span find_live(cn_density_activation activation, const cn_composite_samples *samples, uint32_t ray,
                         uint32_t first, uint32_t at, cn_worker *w)
{
    cn_span s = { at, 0, 0, 1 };
    const float *length = samples->length;
    float *seen = samples->seen;
    const uint32_t end = first + samples->of_ray[ray];
    for (uint32_t i = first; i < end; i++) {
        if (seen) seen[i] = 0;
        if (!(s.after > MIN_TRANSMITTANCE)) continue;
        const float logit = w->logit[i], sigma = cn_density(activation, logit), tau = sigma * length[i];
        if (seen) seen[i] = cn_occupancy_seen(s.after, sigma);
        const float after = s.after * expf(-tau), weight = s.after - after;
        s.after = after;
        if (!(weight > MIN_WEIGHT) && !(samples->others && i % samples->others == 0)) continue;
        w->weight[at] = weight;
        w->behind[at] = after;
        w->tau_gradient[at] = cn_density_gradient(activation, logit, sigma) * length[i];
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

uint32_t cn_composite_gather(const cn_field *field, const cn_composite_samples *samples, cn_worker *w, cn_span *spans)
{
    uint32_t at = 0, first = 0;
    for (uint32_t r = 0; r < samples->n_rays; r++) {
        spans[r] = find_live(field->type->density, samples, r, first, at, w);
        at += spans[r].n;
        first += samples->of_ray[r];
    }
    for (uint32_t i = 0; i < at; i++) {
        copy_lane(w->acts.enc, i, samples->enc, w->live[i], field->enc_rows);
        copy_lane(samples->pos, i, samples->pos, w->live[i], 3); /* in place, forward: i <= live[i] */
    }
    return at;
}

/* From back to front. The background behind the last sample counts as one more sample, of weight `after`. */
void cn_composite_backward(const cn_span *s, float d_after, cn_worker *w)
{
    float sum_behind = s->after * d_after;
    for (uint32_t i = s->first + s->n; i-- > s->first;) {
        const float d_tau = w->behind[i] * w->d_weight[i] - sum_behind;
        w->d_logit[i] = d_tau * w->tau_gradient[i];
        sum_behind += w->weight[i] * w->d_weight[i];
    }
}
