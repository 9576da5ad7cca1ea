#include "colour/icc.h"

#include "base/srgb.h"

#include "bridge/lcms.h"

#include <math.h>
#include <stdlib.h>

struct cn_icc {
    cn_lcms *lcms;
    const char *space;
};

/* The curves of the known spaces: linear light of an encoded value. */
static double curve_adobe(double v)
{
    return pow(v, 563.0 / 256);
}
static double curve_prophoto(double v)
{
    return pow(v, 1.8);
}
static double curve_2020(double v)
{
    return v < 4.5 * 0.018053968510807 ? v / 4.5 : pow((v + 0.09929682680944) / 1.09929682680944, 1 / 0.45);
}

/* XYZ of linear RGB under ICC's D50 (0.9642, 1, 0.8249), from the primaries and the white of each space by Bradford. */
static const struct known {
    const char *space;
    double (*curve)(double);
    double colorants[9];
} known_spaces[] = {
    { "sRGB", cn_srgb_decode, { 0.43604, 0.38511, 0.14305, 0.22248, 0.71691, 0.06061, 0.01392, 0.09707, 0.71391 } },
    { "Display P3",
      cn_srgb_decode,
      { 0.51512, 0.29198, 0.15710, 0.24119, 0.69224, 0.06657, -0.00105, 0.04188, 0.78407 } },
    { "Adobe RGB (1998)",
      curve_adobe,
      { 0.60974, 0.20527, 0.14919, 0.31111, 0.62568, 0.06321, 0.01947, 0.06087, 0.74456 } },
    { "ProPhoto RGB", curve_prophoto, { 0.79767, 0.13519, 0.03134, 0.28804, 0.71187, 0.00009, 0, 0, 0.82490 } },
    { "Rec.2020", curve_2020, { 0.67348, 0.16567, 0.12505, 0.27904, 0.67534, 0.04561, -0.00193, 0.02998, 0.79685 } },
};

/* Tolerance: profiles of one space differ in the rounding of their white and of their tables. A profile that differs
 * by more is applied itself, which is exact. */
#define COLORANT_TOLERANCE 5e-4
#define CURVE_TOLERANCE 2.5e-4

static bool amounts_to(const struct known *k, const double colorants[9], float curves[3][CN_LCMS_CURVE])
{
    for (int i = 0; i < 9; i++)
        if (!(fabs(colorants[i] - k->colorants[i]) < COLORANT_TOLERANCE)) return false;
    for (int i = 0; i < CN_LCMS_CURVE; i++) {
        const double want = k->curve((double)i / (CN_LCMS_CURVE - 1));
        for (int c = 0; c < 3; c++)
            if (!(fabs((double)curves[c][i] - want) < CURVE_TOLERANCE)) return false;
    }
    return true;
}

cn_status cn_icc_create(cn_icc **icc, const void *profile, size_t size, uint32_t channels)
{
    *icc = calloc(1, sizeof **icc);
    if (!*icc) return cn_fail(CN_ERR_NOMEM, "out of memory for an ICC profile");
    cn_status status = cn_lcms_create(&(*icc)->lcms, profile, size);
    if (status == CN_OK && cn_lcms_is_grey((*icc)->lcms) != (channels < 3))
        status = cn_fail(CN_ERR_FORMAT, "its ICC profile is for %s", channels < 3 ? "colours" : "grey pictures");
    double colorants[9];
    float curves[3][CN_LCMS_CURVE];
    if (status == CN_OK && cn_lcms_matrix((*icc)->lcms, colorants, curves))
        for (size_t i = 0; i < sizeof known_spaces / sizeof *known_spaces && !(*icc)->space; i++)
            if (amounts_to(&known_spaces[i], colorants, curves)) (*icc)->space = known_spaces[i].space;
    if (status != CN_OK) cn_icc_destroy(icc);
    return status;
}

void cn_icc_destroy(cn_icc **icc)
{
    if (!*icc) return;
    cn_lcms_destroy(&(*icc)->lcms);
    free(*icc);
    *icc = NULL;
}

const char *cn_icc_space(const cn_icc *icc)
{
    return icc->space;
}

/* Linear ACEScg (AP1, D60) of XYZ (ICC's D50), by Bradford. */
static const double ACESCG_FROM_XYZ[9] = { 1.5926633585099224,  -0.3517856970486894,   -0.22288800245675572,
                                           -0.6759116931850461, 1.6392548132801696,    0.015103941433933517,
                                           0.01996713626986036, -0.022572004147865223, 1.2162925098272104 };

cn_status cn_icc_to_linear(const cn_icc *icc, const cn_colour *own, float *pixels, size_t n, int stride)
{
    if (icc->space) return cn_colour_to_linear(own, icc->space, pixels, n, stride);
    for (size_t i = 0; i < n; i++)
        for (int c = 0; c < 3; c++) {
            float *x = &pixels[i * (size_t)stride + (size_t)c];
            if (!isfinite(*x)) *x = 0;
        }
    cn_lcms_to_xyz(icc->lcms, pixels, n, stride);
    for (size_t i = 0; i < n; i++) {
        float *p = &pixels[i * (size_t)stride];
        const double xyz[3] = { (double)p[0], (double)p[1], (double)p[2] };
        for (int c = 0; c < 3; c++) {
            const double *m = ACESCG_FROM_XYZ + 3 * c;
            p[c] = (float)(m[0] * xyz[0] + m[1] * xyz[1] + m[2] * xyz[2]);
        }
    }
    return CN_OK;
}
