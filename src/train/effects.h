/* The effects of a tile in training: which are on, and what they are told about the photos. parameters.h holds their
 * parameters. Private to train/. */
#ifndef CONURB_TRAIN_EFFECTS_H
#define CONURB_TRAIN_EFFECTS_H
#include "conurb/train.h"
#include "effect/effect.h"
#include "train/parameters.h"
#include "train/sampler.h"

typedef struct cn_train_effects {
    cn_effect_pack pack;
    uint32_t n_photos;
    float *constants;
    float *run;        /* [n_photos], see cn_runs_find; NULL where no effect asks for it */
    float (*trend)[3]; /* [n_photos] of the camera centres (effect/pose.h); NULL where no effect moves rays */
    float *derived;    /* what the effects derive from their shared parameters */
} cn_train_effects;

/* Packs the effects that the tile's plan has on. */
CN_NODISCARD cn_status cn_train_effects_size(cn_train_effects *effects, const cn_plan_tile *tile);
void cn_train_effects_carve(cn_train_effects *effects, cn_arena *arena);
/* Constants, runs and places of the photos, and the first values of the shared parameters. */
void cn_train_effects_begin(cn_train_effects *effects, const cn_train_input *input, const cn_sampler *sampler,
                            float inv_extent, uint64_t seed, cn_parameters *parameters);
/* After a step of Adam: the effects' projections, and what they derive. */
void cn_train_effects_project(const cn_train_effects *effects, cn_parameters *parameters, double progress);
/* Derives anew from the shared parameters. */
void cn_train_effects_derive(const cn_train_effects *effects, const cn_parameters *parameters);
cn_effect_state cn_train_effects_state(const cn_train_effects *effects, const cn_kernel *kernel,
                                       const cn_parameters *parameters);
/* The rays of a group, in the form that effects take. */
cn_effect_rays cn_train_effects_rays(const cn_batch *batch, uint32_t group);
/* Lets the effects move a group's rays. */
void cn_train_effects_move(const cn_train_effects *effects, const cn_effect_state *state, const cn_box *box,
                           uint32_t group, cn_batch *batch);
void cn_train_effects_list(const cn_train_effects *effects, cn_checkpoint *checkpoint);

/* Constants of every effect that is on: for the tile's training photos, then for its held-out photos if the pack has
 * rows for them. They are centred on the training photos, and 0 where a photo does not say, or not all that the
 * training photos say. constants has pack->n_constants floats. */
void cn_train_constants(const cn_train_input *input, const cn_effect_pack *pack, float *constants);
#endif
