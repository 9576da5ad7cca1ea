#include "effect/display.h"

#include "conurb/colour.h"

#include <math.h>

#define CLIPPED 0.98f /* linear sRGB */

static float encode_srgb(float x, float *gradient)
{
    if (x <= 0.0031308f) {
        *gradient = 12.92f;
        return 12.92f * x;
    }
    const float y = powf(x, 1 / 2.4f);
    *gradient = 1.055f / 2.4f * y / x;
    return 1.055f * y - 0.055f;
}

static void to_srgb(const float acescg[3], float srgb[3])
{
    for (int i = 0; i < 3; i++)
        srgb[i] = (float)cn_srgb_from_acescg[3 * i] * acescg[0] + (float)cn_srgb_from_acescg[3 * i + 1] * acescg[1] +
                  (float)cn_srgb_from_acescg[3 * i + 2] * acescg[2];
}

void cn_display(const float acescg[3], float srgb[3])
{
    float unused;
    to_srgb(acescg, srgb);
    for (int i = 0; i < 3; i++)
        srgb[i] = encode_srgb(srgb[i], &unused);
}

float cn_display_error(const float rgb[3], const float target[3], float scale, float d_rgb[3])
{
    float a[3], b[3], error = 0;
    to_srgb(rgb, a);
    to_srgb(target, b);
    for (int c = 0; d_rgb && c < 3; c++)
        d_rgb[c] = 0;
    for (int i = 0; i < 3; i++) {
        float gradient, unused;
        if (b[i] >= CLIPPED && a[i] >= b[i]) continue;
        const float e = encode_srgb(a[i], &gradient) - encode_srgb(b[i], &unused);
        error += e * e;
        for (int c = 0; d_rgb && c < 3; c++)
            d_rgb[c] += 2 * scale * e * gradient * (float)cn_srgb_from_acescg[3 * i + c];
    }
    return error;
}
