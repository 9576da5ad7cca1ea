/* Watches training. A step that would do harm is left out and counted. When there are many of these, or when the
 * loss explodes, training has diverged: the caller goes back to the last healthy state with a tenth of the learning
 * rate. All decisions depend on the steps and none on a clock, so a resumed run decides like an uninterrupted one.
 * Private to train/. */
#ifndef CONURB_TRAIN_MONITOR_H
#define CONURB_TRAIN_MONITOR_H
#include "effect/effect.h"
#include "train/batch.h"
#include "train/checkpoint.h"
#include "train/stats.h"

/* Only doubles: a checkpoint keeps it as an array. */
typedef struct cn_monitor {
    double steps;              /* steps taken since the start, the last rollback, or the start of an effect */
    double loss, best;         /* squared error of a channel, averaged over the last steps; the lowest such mean */
    double unexplained;        /* like loss, but with the rays weighted as in the loss */
    double mean[3], square[3]; /* of the photos' display-encoded colours */
    double trouble;            /* grows with every step that is left out, shrinks with every good step */
    double skipped, rollbacks; /* in all */
    double hooks;              /* number of effects that take part */
} cn_monitor;
enum { CN_MONITOR_VALUES = 14, CN_MONITOR_WHY = 160, CN_MONITOR_MAX_ROLLBACKS = 4 };

/* Whether the step just computed may change the parameters; notes its loss. pack: the effects that take part. */
bool cn_monitor_accepts(cn_monitor *monitor, const cn_step_stats *stats, const cn_effect_pack *pack,
                        const cn_batch *batch);
/* True when training has to go back to a healthy state; says why. */
bool cn_monitor_diverged(const cn_monitor *monitor, char why[CN_MONITOR_WHY]);
/* True when the state is worth keeping for a rollback, by its losses. The parameters have to be finite too. */
bool cn_monitor_healthy(const cn_monitor *monitor);
/* True when the last steps are no better than one colour for all rays; says by how much. */
bool cn_monitor_learnt_nothing(const cn_monitor *monitor, char why[CN_MONITOR_WHY]);
/* Forgets the losses. The counts stay. */
void cn_monitor_reset(cn_monitor *monitor);
/* Weight of the priors (against fog, and for rays that end): 1 while the photos are not explained, and lower the
 * better they are explained. */
float cn_monitor_prior_weight(const cn_monitor *monitor);
/* Factor of the learning rate: a tenth for every rollback. */
double cn_monitor_rate(const cn_monitor *monitor);
void cn_monitor_list(cn_monitor *monitor, cn_checkpoint *checkpoint);
#endif
