#include "train/optimiser.h"

#include <math.h>
#include <string.h>

#define BETA1 0.9
#define BETA2 0.99
#define EPSILON 1e-15f
#define DECAY 1e-6f     /* weight decay */
#define WARM_STEPS 20.0 /* warm-up: short steps until Adam's moments have converged. Not measured apart */
/* The learning rate stays at its full value for CN_RATE_HELD of the schedule, because only long steps remove what
 * long steps have put in mid-air. Then it falls to this part of itself, and the surfaces converge. Tuned on fox with
 * a minute of training: 2 dB better than a fall to 1/30 from the start; no worse than others on castle, sceaux and
 * herz-jesus (tests/bench/experiments.md). */
#define RATE_LAST 0.05

void cn_optimiser_carve(cn_optimiser *o, cn_arena *arena, size_t n, const cn_effect_pack *pack)
{
    o->n = n;
    o->m = CN_ARENA_NEW(arena, float, n);
    o->v = CN_ARENA_NEW(arena, float, n);
    o->n_rows = pack->n_photo;
    o->rows_before = pack->own_rates ? CN_ARENA_NEW(arena, float, pack->n_photo) : NULL;
}

void cn_optimiser_list(const cn_optimiser *o, cn_checkpoint *c)
{
    cn_checkpoint_add(c, "flat.m", CN_F32, o->n, o->m);
    cn_checkpoint_add(c, "flat.v", CN_F32, o->n, o->v);
}

double cn_optimiser_rate(const cn_optimiser *o, cn_step_at at, double factor)
{
    const double done = at.steps ? fmin((double)at.step / at.steps, 1) : 0;
    const double warm = fmin(1, (at.step + 1) / WARM_STEPS);
    return o->learning_rate * factor * warm * pow(RATE_LAST, fmax(0, done - CN_RATE_HELD) / (1 - CN_RATE_HELD));
}

/* There is no bias correction. An entry is updated only when it has a gradient, and (1 - beta1) = sqrt(1 - beta2),
 * so its first step has full length anyway. The dither advances by the golden ratio. */
cn_adam cn_optimiser_table_adam(double rate, uint32_t step)
{
    return (cn_adam){ .rate = (float)rate,
                      .beta1 = (float)BETA1,
                      .beta2 = (float)BETA2,
                      .epsilon = EPSILON,
                      .dither = (step * 2654435769u) >> 16 };
}

cn_adam cn_optimiser_flat_adam(double rate, uint32_t step)
{
    const double n = step + 1.0;
    return (cn_adam){ .rate = (float)(rate * sqrt(1 - pow(BETA2, n)) / (1 - pow(BETA1, n))),
                      .beta1 = (float)BETA1,
                      .beta2 = (float)BETA2,
                      .epsilon = EPSILON,
                      .decay = DECAY };
}

/* Parameters of effects have no decay. Before an effect starts, decay would be its only gradient, and Adam would
 * take it at full length. Rows with their own learning rate have their step scaled afterwards. */
void cn_optimiser_step(cn_optimiser *o, const cn_kernel *kernel, double rate, uint32_t step, const cn_flat_step *flat)
{
    const cn_adam adam = cn_optimiser_flat_adam(rate, step);
    cn_adam no_decay = adam, of_weights = adam;
    no_decay.decay = 0;
    if (flat->weight_rate > 0) of_weights.rate *= (float)flat->weight_rate;
    size_t first[CN_MAX_EFFECTS + 1];
    const size_t w = flat->n_weights;
    float factor[CN_MAX_EFFECTS], *rows = flat->value + w, *before = o->rows_before;
    const uint32_t n_effects = cn_effects_rates(flat->pack, first, factor);
    if (before) memcpy(before, rows, o->n_rows * sizeof *before);
    kernel->adam(&of_weights, flat->value, o->m, o->v, flat->grad, w);
    kernel->adam(&no_decay, rows, o->m + w, o->v + w, flat->grad + w, o->n - w);
    for (uint32_t e = 0; before && e < n_effects; e++)
        for (size_t i = first[e]; factor[e] != 1 && i < first[e + 1]; i++)
            rows[i] = before[i] + factor[e] * (rows[i] - before[i]);
}
