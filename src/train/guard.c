/* Watches over training: steps that would harm are left out and counted; when they come thick, or the loss explodes,
 * the caller goes back to the last good state with a tenth of the learning rate. Everything follows from the steps
 * themselves, never from a clock, so a resumed run decides as an uninterrupted one. */
#include "train/trainer.h"

#include "base/number.h"
#include "effect/display.h"

#include <math.h>
#include <stdio.h>

/* Sum of squares. Adam squares gradients, and a second moment of infinity never comes back. */
#define MAX_GRADIENT 1e30
#define MEMORY 16.0      /* steps that the loss is averaged over */
#define SPIKE 16.0       /* a step whose loss is so many times the mean is left out ... */
#define SPIKE_ABOVE 0.05 /* ... where that is this much at least; a squared error of 1 is black for white */
#define UNEXPLAINED 0.01 /* squared error a channel (20 dB) from which on nothing counts as explained */
#define EXPLODED 3.0     /* the mean over the lowest mean */
#define EXPLODED_ABOVE 0.02
#define MAX_TROUBLE 10.0 /* steps left out, less one for every LEAK good ones */
#define LEAK 8.0
#define GREY_STEPS 256.0 /* by then a field says more than one colour for all rays would */
#define WORSE_THAN_GREY 1.25
#define GREY_ABOVE 0.01
#define GREY_RAYS 256u /* of a step: enough to know the photos' colours by */

_Static_assert(sizeof(cn_guard) == CN_GUARD_VALUES * sizeof(double), "a checkpoint keeps the guard as an array");

void cn_guard_begin_anew(cn_guard *guard)
{
    const cn_guard kept = *guard;
    *guard = (cn_guard){ .skipped = kept.skipped, .returns = kept.returns, .hooks = kept.hooks };
}

/* What is presumed is a prior beside the photos' evidence, and the most probable scene weighs a prior by the variance
 * of what the evidence leaves unexplained. At the full weight to the end, photos of fox in many exposures lose 0.25 dB;
 * at a third of it throughout, scenes of fewer photos, which keep larger errors (brighton, herz-jesus), lose as much.
 * Where an effect tells the loss what not to trust, passers-by in a photo, that error is none of the scene's: counted
 * with it, it takes 0.05 dB from fox with boxes pasted on. */
float cn_guard_doubt(const cn_trainer *t)
{
    const cn_guard *g = &t->guard;
    return g->steps < MEMORY ? 1 : (float)fmin(1, g->unexplained / UNEXPLAINED);
}

double cn_guard_rate(const cn_trainer *t)
{
    return pow(0.1, t->guard.returns);
}

/* Effects that set in change the loss on purpose. */
static void note_hooks(cn_trainer *t)
{
    const cn_effect_pack *p = &t->pack;
    const double hooks = p->ray.n + p->background.n + p->pixel.n + p->loss.n;
    if (hooks != t->guard.hooks) cn_guard_begin_anew(&t->guard);
    t->guard.hooks = hooks;
}

/* The photos' colours, display-encoded, as the loss has them. */
static void note_colours(cn_trainer *t)
{
    cn_guard *g = &t->guard;
    double sum[3] = { 0 }, squares[3] = { 0 }, n = 0;
    for (uint32_t r = 0; r < t->n_rays && n < GREY_RAYS; r++) {
        const float *target = t->target + 4 * (size_t)r;
        float rgb[3];
        if (!(target[3] > 0) || !isfinite(target[0] + target[1] + target[2])) continue;
        cn_display(target, rgb);
        for (int c = 0; c < 3; c++) {
            sum[c] += (double)rgb[c];
            squares[c] += (double)rgb[c] * (double)rgb[c];
        }
        n++;
    }
    if (n == 0) return;
    const double share = 1 / fmin(g->steps, GREY_STEPS);
    for (int c = 0; c < 3; c++) {
        g->mean[c] += share * (sum[c] / n - g->mean[c]);
        g->square[c] += share * (squares[c] / n - g->square[c]);
    }
}

/* Squared error a channel of the best single colour. */
static double grey_loss(const cn_guard *g)
{
    double sum = 0;
    for (int c = 0; c < 3; c++)
        sum += fmax(g->square[c] - g->mean[c] * g->mean[c], 0) / 3;
    return sum;
}

static bool take_out(cn_guard *g)
{
    g->skipped++;
    g->trouble++;
    return false;
}

bool cn_guard_takes(cn_trainer *t)
{
    cn_guard *g = &t->guard;
    const cn_step_stats *s = &t->stats;
    note_hooks(t);
    if (!s->rays && !s->bad) return true; /* no ray met anything: nothing to judge, and nothing to learn */
    const double loss = s->squared_error / (3 * (double)s->rays);
    if (!s->rays || !isfinite(loss) || !(s->gradient <= MAX_GRADIENT)) return take_out(g);
    if (g->steps >= MEMORY && loss > SPIKE * g->loss && loss > SPIKE_ABOVE) return take_out(g);
    g->steps++;
    g->loss += (loss - g->loss) / fmin(g->steps, MEMORY);
    if (s->weight > 0) g->unexplained += (s->weighed_error / (3 * s->weight) - g->unexplained) / fmin(g->steps, MEMORY);
    if (g->steps == MEMORY || (g->steps > MEMORY && g->loss < g->best)) g->best = g->loss;
    g->trouble = fmax(g->trouble - 1 / LEAK, 0);
    note_colours(t);
    return true;
}

static bool exploded(const cn_guard *g, double factor, double above)
{
    return g->steps > MEMORY && g->loss > factor * g->best + above;
}

static bool worse_than_grey(const cn_guard *g)
{
    return g->loss > WORSE_THAN_GREY * grey_loss(g) + GREY_ABOVE;
}

bool cn_guard_despairs(const cn_trainer *t, char why[CN_GUARD_WHY])
{
    const cn_guard *g = &t->guard;
    if (g->trouble > MAX_TROUBLE) {
        snprintf(why, CN_GUARD_WHY, "too many steps without a finite, sane loss and gradient");
        return true;
    }
    if (exploded(g, EXPLODED, EXPLODED_ABOVE)) {
        cn_print(why, CN_GUARD_WHY, "the loss exploded from %.4f to %.4f", g->best, g->loss);
        return true;
    }
    if (g->steps >= GREY_STEPS && worse_than_grey(g)) {
        cn_print(why, CN_GUARD_WHY, "after %.0f steps the loss is %.4f, and one colour for all would have %.4f",
                 g->steps, g->loss, grey_loss(g));
        return true;
    }
    return false;
}

bool cn_guard_content(const cn_trainer *t)
{
    const cn_guard *g = &t->guard;
    if (g->steps < MEMORY) return false;
    return g->trouble == 0 && !exploded(g, 1 + (EXPLODED - 1) / 4, EXPLODED_ABOVE / 4) && !worse_than_grey(g) &&
           cn_guard_finite(t);
}

bool cn_guard_finite(const cn_trainer *t)
{
    bool finite = true;
    for (size_t i = 0; i < t->flat.n; i++)
        finite &= isfinite(t->flat.value[i]) != 0;
    for (size_t i = 0; i < t->table_n; i++)
        finite &= (t->table[i] & 0x7f80u) != 0x7f80u;
    return finite;
}
