#include "bridge/lcms.h"

#include <lcms2.h>
#include <stdlib.h>

struct cn_lcms {
    cmsContext context; /* of its own, so that no setting of the process is touched */
    cmsHPROFILE profile;
    cmsHTRANSFORM to_xyz;
};

static cn_status open_profile(cn_lcms *l, const void *bytes, size_t size)
{
    l->context = cmsCreateContext(NULL, NULL);
    if (!l->context) return cn_fail(CN_ERR_NOMEM, "out of memory for an ICC profile");
    l->profile = size <= UINT32_MAX ? cmsOpenProfileFromMemTHR(l->context, bytes, (cmsUInt32Number)size) : NULL;
    if (!l->profile) return cn_fail(CN_ERR_FORMAT, "its ICC profile is damaged");
    const cmsColorSpaceSignature space = cmsGetColorSpace(l->profile);
    const cmsProfileClassSignature kind = cmsGetDeviceClass(l->profile);
    const bool colours = space == cmsSigRgbData || space == cmsSigGrayData;
    const bool device = kind == cmsSigInputClass || kind == cmsSigDisplayClass || kind == cmsSigOutputClass ||
                        kind == cmsSigColorSpaceClass;
    if (!colours || !device) return cn_fail(CN_ERR_FORMAT, "its ICC profile is not one for RGB or grey pictures");
    cmsHPROFILE xyz = cmsCreateXYZProfileTHR(l->context);
    if (!xyz) return cn_fail(CN_ERR_NOMEM, "out of memory for an ICC profile");
    l->to_xyz = cmsCreateTransformTHR(l->context, l->profile, space == cmsSigRgbData ? TYPE_RGB_FLT : TYPE_GRAY_FLT,
                                      xyz, TYPE_XYZ_FLT, INTENT_RELATIVE_COLORIMETRIC, cmsFLAGS_NOCACHE);
    cmsCloseProfile(xyz);
    return l->to_xyz ? CN_OK : cn_fail(CN_ERR_FORMAT, "its ICC profile lacks the tables that convert colours");
}

cn_status cn_lcms_create(cn_lcms **lcms, const void *profile, size_t size)
{
    *lcms = calloc(1, sizeof **lcms);
    if (!*lcms) return cn_fail(CN_ERR_NOMEM, "out of memory for an ICC profile");
    const cn_status status = open_profile(*lcms, profile, size);
    if (status != CN_OK) cn_lcms_destroy(lcms);
    return status;
}

void cn_lcms_destroy(cn_lcms **lcms)
{
    if (!*lcms) return;
    if ((*lcms)->to_xyz) cmsDeleteTransform((*lcms)->to_xyz);
    if ((*lcms)->profile) cmsCloseProfile((*lcms)->profile);
    if ((*lcms)->context) cmsDeleteContext((*lcms)->context);
    free(*lcms);
    *lcms = NULL;
}

bool cn_lcms_is_grey(const cn_lcms *lcms)
{
    return cmsGetColorSpace(lcms->profile) == cmsSigGrayData;
}

bool cn_lcms_matrix(const cn_lcms *lcms, double colorants[9], float curves[3][CN_LCMS_CURVE])
{
    static const cmsTagSignature tables[] = { cmsSigAToB0Tag, cmsSigAToB1Tag, cmsSigAToB2Tag,
                                              cmsSigDToB0Tag, cmsSigDToB1Tag, cmsSigDToB2Tag };
    static const cmsTagSignature columns[] = { cmsSigRedColorantTag, cmsSigGreenColorantTag, cmsSigBlueColorantTag };
    static const cmsTagSignature tones[] = { cmsSigRedTRCTag, cmsSigGreenTRCTag, cmsSigBlueTRCTag };
    if (cn_lcms_is_grey(lcms) || !cmsIsMatrixShaper(lcms->profile)) return false;
    for (size_t i = 0; i < sizeof tables / sizeof *tables; i++)
        if (cmsIsTag(lcms->profile, tables[i])) return false; /* they come before a matrix */
    for (int c = 0; c < 3; c++) {
        const cmsCIEXYZ *column = cmsReadTag(lcms->profile, columns[c]);
        const cmsToneCurve *tone = cmsReadTag(lcms->profile, tones[c]);
        if (!column || !tone) return false;
        colorants[c] = column->X, colorants[3 + c] = column->Y, colorants[6 + c] = column->Z;
        for (int i = 0; i < CN_LCMS_CURVE; i++)
            curves[c][i] = cmsEvalToneCurveFloat(tone, (float)i / (CN_LCMS_CURVE - 1));
    }
    return true;
}

void cn_lcms_to_xyz(const cn_lcms *lcms, float *pixels, size_t n, int stride)
{
    enum { AT_ONCE = 1024 };
    float in[3 * AT_ONCE], out[3 * AT_ONCE];
    const size_t step = (size_t)stride, channels = cn_lcms_is_grey(lcms) ? 1 : 3;
    for (size_t first = 0; first < n; first += AT_ONCE) {
        const size_t count = n - first < AT_ONCE ? n - first : AT_ONCE;
        float *at = pixels + first * step;
        for (size_t i = 0; i < count; i++)
            for (size_t c = 0; c < channels; c++)
                in[channels * i + c] = at[step * i + c];
        cmsDoTransform(lcms->to_xyz, in, out, (cmsUInt32Number)count);
        for (size_t i = 0; i < count; i++)
            for (size_t c = 0; c < 3; c++)
                at[step * i + c] = out[3 * i + c];
    }
}
