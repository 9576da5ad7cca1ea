/* The curve of sRGB (IEC 61966-2-1): display-encoded values of linear light, and back. Both run from 0 to 1. */
#ifndef CONURB_BASE_SRGB_H
#define CONURB_BASE_SRGB_H
#include <math.h>

static inline double cn_srgb_encode(double linear)
{
    return linear <= 0.0031308 ? 12.92 * linear : 1.055 * pow(linear, 1 / 2.4) - 0.055;
}

static inline double cn_srgb_decode(double encoded)
{
    return encoded <= 0.04045 ? encoded / 12.92 : pow((encoded + 0.055) / 1.055, 2.4);
}

/* In float, with the curve's gradient there. */
static inline float cn_srgb_encode_float(float linear, float *gradient)
{
    if (linear <= 0.0031308f) {
        *gradient = 12.92f;
        return 12.92f * linear;
    }
    const float power = powf(linear, 1 / 2.4f);
    *gradient = 1.055f / 2.4f * power / linear;
    return 1.055f * power - 0.055f;
}
#endif
