/* The error that training reduces. It compares colours as a display shows them. */
#ifndef CONURB_EFFECT_DISPLAY_H
#define CONURB_EFFECT_DISPLAY_H
#include <stdint.h>

/* Linear ACEScg to sRGB, encoded; not clipped. */
void cn_display(const float acescg[3], float srgb[3]);
/* Squared error of display-encoded sRGB, summed over channels. rgb and target are linear ACEScg. Where a channel of the
 * target is at the sensor's limit, a brighter colour is no error. d_rgb: gradient of the error with respect to rgb,
 * times scale; NULL: not asked for. */
float cn_display_error(const float rgb[3], const float target[3], float scale, float d_rgb[3]);
/* The third quartile of n errors; negative ones do not count. 0 when there is none. n: at most CN_EFFECT_RAYS. */
float cn_display_quartile(const float *error, uint32_t n);
#endif
