/* Adam and its schedule. All settings of the optimiser are in optimiser.c. Private to train/. */
#ifndef CONURB_TRAIN_OPTIMISER_H
#define CONURB_TRAIN_OPTIMISER_H
#include "base/arena.h"
#include "effect/effect.h"
#include "kernel/kernel.h"
#include "train/checkpoint.h"
#include "train/sampler.h"

/* Moments of the parameters that are held as floats. The hash table keeps its own, packed (parameters.h). */
typedef struct cn_optimiser {
    float *m, *v; /* [n] */
    size_t n;
    float *rows_before; /* the photos' rows before a step, where an effect has a rate of its own; else NULL */
    size_t n_rows;      /* number of these floats */
    double learning_rate;
} cn_optimiser;

/* The float parameters of a step: weights first, then what belongs to effects, of which the photos' rows come first. */
typedef struct cn_flat_step {
    float *value, *grad; /* grad is 0 afterwards */
    size_t n_weights;
    double weight_rate; /* learning rate of the weights, over the usual one; 0 means 1 */
    const cn_effect_pack *pack;
} cn_flat_step;

void cn_optimiser_carve(cn_optimiser *optimiser, cn_arena *arena, size_t n, const cn_effect_pack *pack);
void cn_optimiser_list(const cn_optimiser *optimiser, cn_checkpoint *checkpoint);
/* The learning rate at this point of the schedule; factor: see cn_monitor_rate. */
double cn_optimiser_rate(const cn_optimiser *optimiser, cn_step_at at, double factor);
/* Adam's settings for parameters of a hash table, which are updated only when they have a gradient. */
cn_adam cn_optimiser_table_adam(double rate, uint32_t step);
/* Adam's settings for the field's weights; parameters of effects have no decay. */
cn_adam cn_optimiser_flat_adam(double rate, uint32_t step);
/* Adam on the float parameters. */
void cn_optimiser_step(cn_optimiser *optimiser, const cn_kernel *kernel, double rate, uint32_t step,
                       const cn_flat_step *flat);
#endif
