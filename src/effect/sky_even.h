/* Hints of sky whose pixels are all sky. */
#ifndef CONURB_EFFECT_SKY_EVEN_H
#define CONURB_EFFECT_SKY_EVEN_H
#include "conurb/photo.h"

/* A hint is found by the pixel in its middle, so a mast or a cable may stand beside that. hint[CN_SKY_HINTS], in the
 * stored picture: of those that show sky, one with a pixel of another colour becomes unknown. What cannot be read stays
 * as it is. */
void cn_sky_even_keep(const cn_pixel_store *pixels, uint32_t photo, uint8_t *hint);
#endif
