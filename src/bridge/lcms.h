/* Little CMS: ICC profiles of photos. Nothing of the process is changed. Any thread; one profile may be used by several
 * threads at once. */
#ifndef CONURB_BRIDGE_LCMS_H
#define CONURB_BRIDGE_LCMS_H
#include "conurb/base.h"

typedef struct cn_lcms cn_lcms;
/* From the bytes of a profile of RGB, or of grey. CN_ERR_FORMAT when it is damaged or for something else (CMYK, a
 * device link). Caller destroys. */
CN_NODISCARD cn_status cn_lcms_create(cn_lcms **lcms, const void *profile, size_t size);
void cn_lcms_destroy(cn_lcms **lcms);
bool cn_lcms_is_grey(const cn_lcms *lcms);
/* What a profile of RGB by a matrix and curves consists of. colorants: row-major, XYZ (D50, as ICC has it) of linear
 * RGB. curves[c][i]: linear light of the value i / (CN_LCMS_CURVE - 1). False when it consists of something else. */
enum { CN_LCMS_CURVE = 256 };
CN_NODISCARD bool cn_lcms_matrix(const cn_lcms *lcms, double colorants[9], float curves[3][CN_LCMS_CURVE]);
/* Values (a grey profile's in the first of three) to XYZ (D50) by the relative colorimetric intent, in place; n pixels
 * of stride floats, of which the first three are used. */
void cn_lcms_to_xyz(const cn_lcms *lcms, float *pixels, size_t n, int stride);
#endif
