#include "train/monitor.h"

#include "base/number.h"
#include "effect/display.h"

#include <math.h>
#include <stdio.h>

/* Sum of squares. Adam squares gradients: an infinite one would make the second moment infinite for good. */
#define MAX_GRADIENT 1e30
/* Limits of what counts as trouble. Set with wide margins; not measured apart. */
#define MEMORY 16.0      /* steps that the loss is averaged over */
#define SPIKE 16.0       /* a step is left out when its loss is so many times the mean ... */
#define SPIKE_ABOVE 0.05 /* ... and is at least this; black in place of white has a squared error of 1 */
#define UNEXPLAINED 0.01 /* squared error of a channel (20 dB); from there on nothing counts as explained */
#define EXPLODED 3.0     /* the mean over the lowest mean */
#define EXPLODED_ABOVE 0.02
#define MAX_TROUBLE 10.0 /* number of steps left out, less one for every LEAK good steps */
#define LEAK 8.0
#define GREY_STEPS 256.0 /* after so many steps a field is better than one colour for all rays */
#define WORSE_THAN_GREY 1.25
#define GREY_ABOVE 0.01
#define GREY_RAYS 256u /* the fewest rays of a step from which the photos' colours can be told */

_Static_assert(sizeof(cn_monitor) == CN_MONITOR_VALUES * sizeof(double), "a checkpoint keeps the monitor as an array");

void cn_monitor_reset(cn_monitor *g)
{
    const cn_monitor kept = *g;
    *g = (cn_monitor){ .skipped = kept.skipped, .rollbacks = kept.rollbacks, .hooks = kept.hooks };
}

/* Priors and photos are weighed against each other. In the most probable scene a prior's weight is proportional to
 * the variance that the photos leave unexplained. Tuned on fox, brighton and herz-jesus. With the full weight to the
 * end, photos of fox in many exposures lose 0.25 dB. With a third of it throughout, brighton and herz-jesus, which
 * have fewer photos and larger errors, lose as much. An effect may tell the loss which rays not to trust (passers-by
 * in a photo). Their error does not count: counting it costs 0.05 dB on fox with boxes pasted on. */
float cn_monitor_prior_weight(const cn_monitor *g)
{
    return g->steps < MEMORY ? 1 : (float)fmin(1, g->unexplained / UNEXPLAINED);
}

double cn_monitor_rate(const cn_monitor *g)
{
    return pow(0.1, g->rollbacks);
}

void cn_monitor_list(cn_monitor *g, cn_checkpoint *c)
{
    cn_checkpoint_add(c, "state.monitor", CN_F64, CN_MONITOR_VALUES, g);
}

/* An effect that sets in changes the loss, which is no fault. */
static void note_hooks(cn_monitor *g, const cn_effect_pack *p)
{
    const double hooks = p->ray.n + p->background.n + p->pixel.n + p->loss.n;
    if (hooks != g->hooks) cn_monitor_reset(g);
    g->hooks = hooks;
}

static void sum_colours(const cn_batch *batch, cn_step_stats *sum)
{
    for (uint32_t r = 0; r < batch->n_rays && sum->colours < GREY_RAYS; r++) {
        const float *target = batch->target + 4 * (size_t)r;
        float rgb[3];
        if (!(target[3] > 0) || !isfinite(target[0] + target[1] + target[2])) continue;
        cn_display(target, rgb);
        for (int c = 0; c < 3; c++) {
            sum->colour[c] += (double)rgb[c];
            sum->colour_squared[c] += (double)rgb[c] * (double)rgb[c];
        }
        sum->colours++;
    }
}

/* Notes the photos' colours, display-encoded, as the loss compares them. A device that has drawn the rays has summed
 * them. */
static void note_colours(cn_monitor *g, const cn_step_stats *stats, const cn_batch *batch)
{
    cn_step_stats sum = *stats;
    if (!(sum.colours > 0)) sum_colours(batch, &sum);
    if (!(sum.colours > 0)) return;
    const double share = 1 / fmin(g->steps, GREY_STEPS);
    for (int c = 0; c < 3; c++) {
        g->mean[c] += share * (sum.colour[c] / sum.colours - g->mean[c]);
        g->square[c] += share * (sum.colour_squared[c] / sum.colours - g->square[c]);
    }
}

/* Squared error of a channel, if all rays had the best single colour. */
static double grey_loss(const cn_monitor *g)
{
    double sum = 0;
    for (int c = 0; c < 3; c++)
        sum += fmax(g->square[c] - g->mean[c] * g->mean[c], 0) / 3;
    return sum;
}

static bool leave_out(cn_monitor *g)
{
    g->skipped++;
    g->trouble++;
    return false;
}

bool cn_monitor_accepts(cn_monitor *g, const cn_step_stats *s, const cn_effect_pack *pack, const cn_batch *batch)
{
    note_hooks(g, pack);
    if (!s->rays && !s->bad) return true; /* no ray has a sample: the step has no loss and no gradient */
    const double loss = s->squared_error / (3 * (double)s->rays);
    if (!s->rays || !isfinite(loss) || !(s->gradient <= MAX_GRADIENT)) return leave_out(g);
    if (g->steps >= MEMORY && loss > SPIKE * g->loss && loss > SPIKE_ABOVE) return leave_out(g);
    g->steps++;
    g->loss += (loss - g->loss) / fmin(g->steps, MEMORY);
    if (s->weight > 0) g->unexplained += (s->weighed_error / (3 * s->weight) - g->unexplained) / fmin(g->steps, MEMORY);
    if (g->steps == MEMORY || (g->steps > MEMORY && g->loss < g->best)) g->best = g->loss;
    g->trouble = fmax(g->trouble - 1 / LEAK, 0);
    note_colours(g, s, batch);
    return true;
}

static bool exploded(const cn_monitor *g, double factor, double above)
{
    return g->steps > MEMORY && g->loss > factor * g->best + above;
}

static bool worse_than_grey(const cn_monitor *g)
{
    return g->loss > WORSE_THAN_GREY * grey_loss(g) + GREY_ABOVE;
}

bool cn_monitor_diverged(const cn_monitor *g, char why[CN_MONITOR_WHY])
{
    if (g->trouble > MAX_TROUBLE) {
        snprintf(why, CN_MONITOR_WHY, "too many steps without a finite, sane loss and gradient");
        return true;
    }
    if (exploded(g, EXPLODED, EXPLODED_ABOVE)) {
        cn_print(why, CN_MONITOR_WHY, "the loss exploded from %.4f to %.4f", g->best, g->loss);
        return true;
    }
    if (g->steps >= GREY_STEPS && worse_than_grey(g)) {
        cn_print(why, CN_MONITOR_WHY, "after %.0f steps the loss is %.4f, and one colour for all would have %.4f",
                 g->steps, g->loss, grey_loss(g));
        return true;
    }
    return false;
}

bool cn_monitor_learnt_nothing(const cn_monitor *g, char why[CN_MONITOR_WHY])
{
    if (!(g->steps + g->skipped > 0)) {
        snprintf(why, CN_MONITOR_WHY, "no step had a ray with a usable pixel");
        return true;
    }
    if (!(g->steps > 0) || !worse_than_grey(g)) return false;
    cn_print(why, CN_MONITOR_WHY, "its loss is %.3g, and one colour for all would have %.3g", g->loss, grey_loss(g));
    return true;
}

bool cn_monitor_healthy(const cn_monitor *g)
{
    if (g->steps < MEMORY) return false;
    return g->trouble == 0 && !exploded(g, 1 + (EXPLODED - 1) / 4, EXPLODED_ABOVE / 4) && !worse_than_grey(g);
}
