/* The settings that a time budget chooses for a tile, kept for when its training goes on. */
#ifndef CONURB_STAGE_CHOICE_H
#define CONURB_STAGE_CHOICE_H
#include "city/workspace.h"
#include "conurb/train.h"
#include "record/record.h"

/* Where request->choose, *chosen becomes the settings for its budget, said in the log; else the request itself.
 * CITY/tiles/ID/choice.json keeps them for the stage, so that a run that was stopped goes on with what it began with,
 * on whatever machine. */
CN_NODISCARD cn_status cn_choice_make(const cn_context *ctx, const cn_city *city, const cn_train_options *request,
                                      const cn_plan_tile *tile, const cn_stage *stage, cn_train_options *chosen);
#endif
