/* Probes: where the evidence for an effect is near its threshold, short trainings of the tile with and without it are
 * scored on photos of their own, taken from the tile's training photos, and decide. The same photos and the same seed
 * train both, and gains are compared photo by photo. The held-out photos have no say. */
#ifndef CONURB_STAGE_EFFECT_PROBE_H
#define CONURB_STAGE_EFFECT_PROBE_H
#include "city/workspace.h"
#include "stage/validation.h"

enum { CN_PROBE_ROUNDS = 3 }; /* pairs of trainings for one effect, at most, each from another seed */

/* What one training reached: half-photo PSNR of each validation photo, dB. */
typedef struct cn_probe_score {
    uint32_t n;
    double psnr[CN_VALIDATION_MOST];
    double seconds; /* seconds by the clock, of training and scoring; only for the log */
} cn_probe_score;

/* Trains `tile` with the effects that it has on, from the seed of that round, and scores it. */
typedef struct cn_probe_runner {
    cn_status (*run)(void *user, const cn_plan_tile *tile, uint32_t round, cn_probe_score *score);
    void *user;
} cn_probe_runner;

/* What the probes of a tile may cost, in steps and trainings. A clock has no part in it. */
typedef struct cn_probe_budget {
    uint32_t effects[CN_MAX_EFFECTS]; /* those in doubt that are tried, nearest to their threshold first */
    uint32_t n_effects;               /* 0: no probes */
    uint32_t steps, trainings;        /* steps of one training, and how many trainings at most */
} cn_probe_budget;

/* The effects in doubt: decided by evidence within a factor of four of the threshold, or by evidence below the
 * threshold that can only speak for an effect (on_unmeasured), where the photos share a light. Where a probe of the
 * latter is not clear, it is on. */
uint32_t cn_probe_doubtful(const cn_plan_tile *tile, uint32_t effects[CN_MAX_EFFECTS]);
/* steps: training steps that all probes together may take. Where they do not suffice for all effects in doubt, the
 * ones farthest from their threshold are left to the evidence. */
cn_probe_budget cn_probe_budget_of(const cn_plan_tile *tile, double steps);
/* Tries the budget's effects in turn, each beside the best choice so far. An effect is on where it gains significantly
 * more than its price, off where significantly less, and else as it was. `reason` says what was measured. */
CN_NODISCARD cn_status cn_probe_decide(const cn_context *ctx, const cn_probe_runner *runner,
                                       const cn_probe_budget *budget, cn_plan_tile *tile);
/* Probes for every tile of the plan that has effects in doubt. Tiles that agree in their decisions and doubts share the
 * probes of the one with the most photos. Each training's figures are kept as CITY/probes/KEY.json: a run that was
 * stopped loses one training at most. dry_run: says what it would do. */
CN_NODISCARD cn_status cn_probe_plan(const cn_context *ctx, const cn_city *city, const cn_dataset *dataset,
                                     cn_plan *plan, bool dry_run);
#endif
