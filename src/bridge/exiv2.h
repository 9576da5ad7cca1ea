/* exiv2 behind C: EXIF with its rationals as doubles. Every call is thread-safe. What exiv2 would print while a call
 * runs is dropped on that thread; on other threads it goes where it went before. */
#ifndef CONURB_BRIDGE_EXIV2_H
#define CONURB_BRIDGE_EXIV2_H
#include "bridge/exif.h"

#ifdef __cplusplus
extern "C" {
#endif

/* CN_ERR_FORMAT when the file cannot be read, is of a kind that exiv2 does not know (EXR), or holds no EXIF. Nothing is
 * known then: numbers are NaN, texts are "". */
CN_NODISCARD cn_status cn_exiv2_read(const char *path, cn_exif *exif);

#ifdef __cplusplus
}
#endif
#endif
