/* Pictures in memory: area resampling with weights, half floats. */
#ifndef CONURB_IMAGE_IMAGE_H
#define CONURB_IMAGE_IMAGE_H
#include "conurb/base.h"

/* Area average of RGBW pixels (linear light, W a weight in [0,1]) from w x h to out_w x out_h, neither larger than the
 * input's. A pixel on a border counts by the fraction that is covered. Colours are weighted by W. The output's W is
 * the mean; where it is 0, the colour is 0. A pixel that is not finite has weight 0. out may not alias. Any thread. */
void cn_image_shrink(const float *in, uint32_t w, uint32_t h, float *out, uint32_t out_w, uint32_t out_h);
/* IEEE half, round to nearest even; past the range saturates at 65504. */
uint16_t cn_half_from_float(float x);
float cn_half_to_float(uint16_t h);
#endif
