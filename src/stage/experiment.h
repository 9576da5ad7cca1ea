/* Experiments: one tile is trained with other settings than the plan's and scored. Results are kept below
 * CITY/tradeoff/, so that a stopped comparison resumes. */
#ifndef CONURB_STAGE_EXPERIMENT_H
#define CONURB_STAGE_EXPERIMENT_H
#include "conurb/measure.h"
#include "conurb/train.h"
#include "renderer/tile_cache.h"

typedef struct cn_experiment {
    char name[64]; /* valid as a folder name */
    cn_train_options options;
    uint32_t width_px;        /* working width of the training photos; 0: the city's. Scores always use the city's */
    const cn_plan_tile *tile; /* with the effects to use; borrowed */
    const char *truth;        /* folder of true depths of held-out photos; NULL: none */
    /* measured */
    double train_s, render_s; /* render_s: median of a held-out photo */
    uint64_t bytes, disk;     /* memory of training; the tile's file */
    cn_score plain, half;
    double depth_error_m, depth_within; /* NaN without a truth */
    double train_psnr;                  /* of the training photos, at the end */
} cn_experiment;

/* Trains and scores, or reads the result of an earlier run of the same experiment. Reports progress. */
CN_NODISCARD cn_status cn_experiment_run(const cn_context *ctx, const cn_city *city, const cn_dataset *dataset,
                                         cn_experiment *experiment);

/* Scores the held-out photos of one tile, trained below `folder` (relative to the city). (stage_eval.c) */
typedef struct cn_evaluated {
    const cn_plan_tile *tile;
    const char *folder, *truth; /* truth: as in cn_experiment */
    bool half_only;             /* saves time: only the scores of right halves count, others may be NaN */
} cn_evaluated;
CN_NODISCARD cn_status cn_evaluate_tile(const cn_context *ctx, const cn_city *city, const cn_dataset *dataset,
                                        const cn_evaluated *of, cn_eval *eval);
#endif
