/* What sky.c and sky_by_input.c share. Private to effect/. */
#ifndef CONURB_EFFECT_SKY_H
#define CONURB_EFFECT_SKY_H
#include "effect/effect.h"
#include "effect/head.h"

enum { CN_SKY_IN = 16, CN_SKY_WIDTH = 32, CN_SKY_OUT = 4 /* a width is a multiple of 4 */ };
/* The head that draws the mean sky (sky_head.c): of 16 harmonics three colours before their activation; the fourth
 * output is 0. */
extern const cn_head cn_sky_head;
/* Sets the head's input for ray i. */
void cn_sky_see(const float dir[3], const cn_head_acts *acts, uint32_t i);
/* The sky effect's hook of that name (sky_settle.c). */
bool cn_sky_settle(const cn_kernel *kernel, const cn_effect_looks *looks, float *shared);

/* Weight of the sky in a direction. It is 0 below the horizon, so that the field has to explain the ground. */
static inline float cn_sky_cover(const float dir[3])
{
    const float x = (dir[2] + 0.15f) / 0.15f, t = x < 0 ? 0 : x > 1 ? 1 : x;
    return t * t * (3 - 2 * t);
}
#endif
