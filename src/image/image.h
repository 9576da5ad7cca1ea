/* Pictures in memory: area resampling with weights, half floats. */
#ifndef CONURB_IMAGE_IMAGE_H
#define CONURB_IMAGE_IMAGE_H
#include "conurb/base.h"

/* Area average of RGBW pixels (linear light, W a weight in [0,1]) from w x h to out_w x out_h, neither larger than the
 * input's. Pixels on a border count by the fraction covered. Colours are averaged by weight; the output's weight is the
 * mean weight, its colour 0 where that is 0. Pixels that are not finite weigh 0. out may not alias. Thread-safe. */
void cn_image_shrink(const float *in, uint32_t w, uint32_t h, float *out, uint32_t out_w, uint32_t out_h);
/* IEEE half, round to nearest even; past the range saturates at 65504. */
uint16_t cn_half_from_float(float x);
float cn_half_to_float(uint16_t h);
#endif
