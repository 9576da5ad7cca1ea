/* A C interface of OpenColorIO. */
#ifndef CONURB_BRIDGE_OCIO_H
#define CONURB_BRIDGE_OCIO_H
#include "conurb/base.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_ocio cn_ocio;
/* A setting of the whole process: OpenColorIO logs nothing. */
void cn_ocio_own_process(void);
/* From a file, or from the text of a config when path is NULL. CN_ERR_CONFIG names the config and the fault. */
CN_NODISCARD cn_status cn_ocio_create(cn_ocio **ocio, const char *path, const char *text);
void cn_ocio_destroy(cn_ocio **ocio);
/* The first of these names (colour spaces, aliases or roles; NULL ends the list) that the config has, or NULL. */
const char *cn_ocio_first_space(const cn_ocio *ocio, const char *const *names);
/* In place; n pixels of stride 3 or 4 floats. Thread-safe. */
CN_NODISCARD cn_status cn_ocio_convert(const cn_ocio *ocio, const char *from, const char *to, float *pixels, size_t n,
                                       int stride);
/* From the scene-linear space `from` through exposure (stops) and look (NULL: none) to a view of the default display.
 */
typedef struct cn_ocio_look {
    const char *from, *view, *look;
    double exposure_ev;
} cn_ocio_look;
/* In place. Thread-safe. */
CN_NODISCARD cn_status cn_ocio_display(const cn_ocio *ocio, const cn_ocio_look *look, float *pixels, size_t n,
                                       int stride);
/* Views of the default display, its default view first, NULL-terminated; owned by ocio. */
const char *const *cn_ocio_views(const cn_ocio *ocio);
/* Looks of the config, NULL-terminated; owned by ocio. */
const char *const *cn_ocio_looks(const cn_ocio *ocio);

#ifdef __cplusplus
}
#endif
#endif
