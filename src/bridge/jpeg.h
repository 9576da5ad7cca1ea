/* Which of libjpeg's warnings, as OpenImageIO passes them on, leave a whole picture. */
#ifndef CONURB_BRIDGE_JPEG_H
#define CONURB_BRIDGE_JPEG_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

/* True when path is a JPEG that ends as one does, and the warning speaks of no lost pixels. Any thread. */
bool cn_jpeg_is_whole(const char *path, const char *warning);

#ifdef __cplusplus
}
#endif
#endif
