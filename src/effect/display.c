#include "effect/display.h"

#include "base/srgb.h"
#include "effect/effect.h"

#include "conurb/colour.h"

#include <math.h>

#define CLIPPED 0.98f /* linear sRGB */

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
        srgb[i] = cn_srgb_encode_float(srgb[i], &unused);
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
        const float e = cn_srgb_encode_float(a[i], &gradient) - cn_srgb_encode_float(b[i], &unused);
        error += e * e;
        for (int c = 0; d_rgb && c < 3; c++)
            d_rgb[c] += 2 * scale * e * gradient * (float)cn_srgb_from_acescg[3 * i + c];
    }
    return error;
}

float cn_display_quartile(const float *error, uint32_t n)
{
    float ascending[CN_EFFECT_RAYS];
    uint32_t n_sorted = 0;
    for (uint32_t i = 0; i < n; i++) {
        if (!(error[i] >= 0)) continue;
        uint32_t at = n_sorted++;
        for (; at && ascending[at - 1] > error[i]; at--)
            ascending[at] = ascending[at - 1];
        ascending[at] = error[i];
    }
    return n_sorted ? ascending[n_sorted * 3 / 4] : 0;
}
