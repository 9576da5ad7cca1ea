#include "train/curve.h"

#include <math.h>
#include <string.h>

void cn_curve_add(cn_curve *curve, double at_s, double psnr)
{
    if (!isfinite(psnr)) return;
    if (curve->n == CN_CURVE_POINTS) {
        curve->n--;
        memmove(curve->at_s, curve->at_s + 1, curve->n * sizeof *curve->at_s);
        memmove(curve->psnr, curve->psnr + 1, curve->n * sizeof *curve->psnr);
    }
    curve->at_s[curve->n] = at_s;
    curve->psnr[curve->n++] = psnr;
}

double cn_curve_gain(const cn_curve *curve, double seconds)
{
    double at = 0, psnr = 0, both = 0, square = 0;
    if (curve->n < CN_CURVE_POINTS) return INFINITY;
    for (uint32_t i = 0; i < curve->n; i++) {
        at += curve->at_s[i] / curve->n;
        psnr += curve->psnr[i] / curve->n;
    }
    for (uint32_t i = 0; i < curve->n; i++) {
        both += (curve->at_s[i] - at) * (curve->psnr[i] - psnr);
        square += (curve->at_s[i] - at) * (curve->at_s[i] - at);
    }
    return square > 0 ? seconds * both / square : INFINITY;
}
