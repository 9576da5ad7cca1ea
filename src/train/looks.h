/* Where the trained photos look. Private to train/. */
#ifndef CONURB_TRAIN_LOOKS_H
#define CONURB_TRAIN_LOOKS_H
#include "effect/effect.h"
#include "tile/seen.h"
#include "train/sampler.h"

enum { CN_LOOKS = 960 }; /* directions of a hemisphere: 4.7 degrees apart */

/* Fills dir[CN_LOOKS], directions above 9 degrees below the horizon, evenly; and look[CN_LOOKS], a cn_look each. */
void cn_looks_find(const cn_sampler *sampler, float (*dir)[3], uint8_t *look);
/* What a tile keeps of where the photos look (tile/seen.h). In the trainer's arena. */
typedef struct cn_looks {
    uint32_t *places;
    uint8_t *matter;
    float *distance, *reach;
} cn_looks;
void cn_looks_carve(cn_looks *looks, cn_arena *arena);
/* Fills them. usable: [CN_OCC_CELLS] cells that photos see. */
CN_NODISCARD cn_status cn_looks_begin(cn_looks *looks, const cn_sampler *sampler, const uint8_t *usable);
/* Sets usable[cell] to 0 where two photos show sky all over the cell. Matter there would be a mistake of training: haze
 * in the glow of the sun, say. */
CN_NODISCARD cn_status cn_looks_clear(const cn_sampler *sampler, cn_pool *pool, const cn_box *box, uint8_t *usable);
#endif
