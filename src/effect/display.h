/* The error that training reduces: of colours as they are displayed. */
#ifndef CONURB_EFFECT_DISPLAY_H
#define CONURB_EFFECT_DISPLAY_H

/* Linear ACEScg to sRGB, encoded; not clipped. */
void cn_display(const float acescg[3], float srgb[3]);
/* Squared error of display-encoded sRGB, summed over channels; both are linear ACEScg. A channel of the target at the
 * sensor's limit says "at least so bright". d_rgb is the error's gradient with respect to rgb, times scale; NULL where
 * it is not wanted. */
float cn_display_error(const float rgb[3], const float target[3], float scale, float d_rgb[3]);
#endif
