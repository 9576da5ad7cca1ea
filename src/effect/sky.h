/* What sky.c and sky_by_input.c share. Private to effect/. */
#ifndef CONURB_EFFECT_SKY_H
#define CONURB_EFFECT_SKY_H
#include "effect/effect.h"

/* Weight of the sky in a direction. It is 0 below the horizon, so that the field has to explain the ground. */
static inline float cn_sky_cover(const float dir[3])
{
    const float x = (dir[2] + 0.15f) / 0.15f, t = x < 0 ? 0 : x > 1 ? 1 : x;
    return t * t * (3 - 2 * t);
}
#endif
