/* Where photos show sky, and where they do not: found in the photos' pixels and from sparse points. */
#ifndef CONURB_EFFECT_SKY_HINTS_H
#define CONURB_EFFECT_SKY_HINTS_H
#include "conurb/plan.h"
#include "effect/sky_grid.h"

/* hint[tile->n_photos][CN_SKY_HINTS], each a cn_sky_hint. A photo without points has no hints. False: out of memory. */
bool cn_sky_hints_find(const cn_plan_input *input, const cn_plan_tile *tile, uint8_t *hint);
/* The share of the photos' area that shows sky, of those photos that have points; what may be a ceiling counts a
 * twentieth. NaN when it cannot be measured. */
double cn_sky_hints_share(const cn_plan_input *input, const cn_plan_tile *tile);
#endif
