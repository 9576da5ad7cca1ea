/* A C interface of exiv2: EXIF with rationals as doubles. Any thread. Messages of exiv2 during a call are dropped on
 * that thread; on other threads they go where they went before. */
#ifndef CONURB_BRIDGE_EXIV2_H
#define CONURB_BRIDGE_EXIV2_H
#include "bridge/exif.h"

#ifdef __cplusplus
extern "C" {
#endif

/* CN_ERR_FORMAT: the file cannot be read, has a format that exiv2 does not support (EXR), or has neither EXIF nor XMP.
 * Then all numbers are NaN and all texts "". */
CN_NODISCARD cn_status cn_exiv2_read(const char *path, cn_exif *exif);
/* The bytes of the ICC profile, malloc'ed, caller frees; NULL when the file has none, or exiv2 cannot read it.
 * CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_exiv2_read_icc(const char *path, void **profile, size_t *size);
/* Adds the XMP of a photo of all directions to a picture of this size (Google's Photo Sphere XMP). CN_ERR_IO. */
CN_NODISCARD cn_status cn_exiv2_mark_equirectangular(const char *path, uint32_t width, uint32_t height);

#ifdef __cplusplus
}
#endif
#endif
