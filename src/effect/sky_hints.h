/* Where photos show sky, and where they do not: found in the photos' pixels and from sparse points. */
#ifndef CONURB_EFFECT_SKY_HINTS_H
#define CONURB_EFFECT_SKY_HINTS_H
#include "conurb/plan.h"
#include "effect/sky_grid.h"

/* CN_SKY_NONE: the photo shows no sky there. CN_SKY_NONE_LATE: so too, but training has gone on for so long that no
 * more matter is asked for there. Neither tells the sky's colour. CN_SKY_NONE_LAST: so too, but training is about to
 * end, and where matter still lacks, the sky may stand for it. */
typedef enum cn_sky_hint { CN_SKY_UNKNOWN, CN_SKY_NONE, CN_SKY_SHOWN, CN_SKY_NONE_LATE, CN_SKY_NONE_LAST } cn_sky_hint;

/* hint[tile->n_photos][CN_SKY_HINTS], each a cn_sky_hint. A photo without points has no hints. False: out of memory. */
bool cn_sky_hints_find(const cn_plan_input *input, const cn_plan_tile *tile, uint8_t *hint);
/* The share of the photos' area that shows sky, of those photos that have points; NaN when it cannot be measured. */
double cn_sky_hints_share(const cn_plan_input *input, const cn_plan_tile *tile);
#endif
