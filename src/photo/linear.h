/* The colours of a decoded photo, to linear ACEScg. */
#ifndef CONURB_PHOTO_LINEAR_H
#define CONURB_PHOTO_LINEAR_H
#include "bridge/oiio.h"
#include "conurb/colour.h"

/* In place; n pixels of RGBA as cn_oiio_read_rgba gives them, alpha not multiplied in. The file's chromaticities (EXR)
 * tell first, then its ICC profile; without either, integers are sRGB and floats linear sRGB. *unread says why a
 * profile could not be used and the colours were taken as if there were none; NULL otherwise; caller frees. own:
 * Conurb's own config. */
CN_NODISCARD cn_status cn_photo_to_linear(const cn_colour *own, const char *path, const cn_oiio_info *info, float *rgba,
                                          size_t n, char **unread);
#endif
