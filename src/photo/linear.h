/* Converts the colours of a decoded photo to linear ACEScg. */
#ifndef CONURB_PHOTO_LINEAR_H
#define CONURB_PHOTO_LINEAR_H
#include "bridge/oiio.h"
#include "conurb/colour.h"

/* Converts n RGBA pixels (as from cn_oiio_read_rgba, not premultiplied) in place. The file's chromaticities (EXR)
 * decide first, then its ICC profile; without either, integers are sRGB and floats linear sRGB. *unread: why a profile
 * could not be used and was ignored; else NULL; the caller frees it. own: Conurb's own config. */
CN_NODISCARD cn_status cn_photo_to_linear(const cn_colour *own, const char *path, const cn_oiio_info *info, float *rgba,
                                          size_t n, char **unread);
#endif
