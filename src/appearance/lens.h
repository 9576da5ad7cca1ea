/* What a photo's lens does to its light, where a tile was trained on photos without it. */
#ifndef CONURB_APPEARANCE_LENS_H
#define CONURB_APPEARANCE_LENS_H
#include "city/workspace.h"
#include "conurb/tile.h"
#include "effect/vignetting.h"

/* The vignetting of one of the dataset's views, as the training of this tile took it out of its photos; none where the
 * tile has no such effect, and where it cannot be measured. The tile is one of the plan, or an experiment with one.
 * CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_lens_vignetting(const cn_dataset *dataset, const cn_tile *tile, const cn_view *view,
                                          cn_vignetting *v);
#endif
