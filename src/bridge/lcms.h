/* Little CMS: ICC profiles of photos. No setting of the process is changed. Any thread; several threads may use one
 * profile at the same time. */
#ifndef CONURB_BRIDGE_LCMS_H
#define CONURB_BRIDGE_LCMS_H
#include "conurb/base.h"

typedef struct cn_lcms cn_lcms;
/* Reads an RGB or grey profile from its bytes. CN_ERR_FORMAT: it is damaged, or of another kind (CMYK, a device link).
 * The caller destroys it. */
CN_NODISCARD cn_status cn_lcms_create(cn_lcms **lcms, const void *profile, size_t size);
void cn_lcms_destroy(cn_lcms **lcms);
bool cn_lcms_is_grey(const cn_lcms *lcms);
/* The parts of an RGB profile with a matrix and curves. colorants: row-major, from linear RGB to XYZ (D50, as in ICC).
 * curves[c][i]: linear light of the value i / (CN_LCMS_CURVE - 1). False: the profile has other parts. */
enum { CN_LCMS_CURVE = 256 };
CN_NODISCARD bool cn_lcms_matrix(const cn_lcms *lcms, double colorants[9], float curves[3][CN_LCMS_CURVE]);
/* Converts n pixels to XYZ (D50) in place, relative colorimetric. A pixel has `stride` floats, of which the first
 * three are used; a grey value is the first of them. */
void cn_lcms_to_xyz(const cn_lcms *lcms, float *pixels, size_t n, int stride);
#endif
