/* The settings that are chosen for a tile's time budget. They are kept for a resume. */
#ifndef CONURB_STAGE_CHOICE_H
#define CONURB_STAGE_CHOICE_H
#include "city/workspace.h"
#include "conurb/train.h"
#include "record/record.h"

/* With request->choose, *chosen receives the settings for the budget, and the log names them; otherwise the request
 * itself. CITY/tiles/ID/choice.json keeps them, so that a stopped run resumes with the same settings on any machine. */
CN_NODISCARD cn_status cn_choice_make(const cn_context *ctx, const cn_city *city, const cn_train_options *request,
                                      const cn_plan_tile *tile, const cn_stage *stage, cn_train_options *chosen);
#endif
