/* Vignetting: a lens shows the corners of a picture darker than its middle. */
#ifndef CONURB_EFFECT_VIGNETTING_H
#define CONURB_EFFECT_VIGNETTING_H
#include "conurb/plan.h"

/* A pixel's linear light is the scene's times 2^(square s + fourth s^2), s the squared distance from the picture's
 * middle, 1 at its corners. All 0: no vignetting. */
typedef struct cn_vignetting {
    float square, fourth; /* stops */
} cn_vignetting;

/* The vignetting of n views, found from the colours of the tile's tracked points. Views of one camera have the same.
 * CN_ERR_DATA: too few points; CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_vignetting_find(const cn_plan_input *input, const cn_plan_tile *tile, uint32_t n,
                                          const uint32_t *views, cn_vignetting *of);
/* The factor on linear light at a place in a picture of this size, pixels. */
float cn_vignetting_factor(const cn_vignetting *v, cn_pixel_extent size, double x, double y);
/* What the pixel would show without vignetting. rgb: linear, in place; rounded to half floats, as the pixel store has
 * them, so that a device that is given corrected pixels trains on the same values. */
void cn_vignetting_remove(const cn_vignetting *v, cn_pixel_extent size, uint32_t x, uint32_t y, float rgb[3]);
static inline bool cn_vignetting_is_none(const cn_vignetting *v)
{
    return v->square == 0 && v->fourth == 0;
}
#endif
