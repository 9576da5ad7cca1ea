/* OpenImageIO behind C. Buffers are the caller's; every call is thread-safe. */
#ifndef CONURB_BRIDGE_OIIO_H
#define CONURB_BRIDGE_OIIO_H
#include "conurb/base.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_oiio_info {
    uint32_t width, height, channels; /* as stored */
    int orientation;                  /* EXIF 1..8, 1 if absent */
    bool is_float;                    /* half or float samples: already linear */
    char colour_space[64];            /* oiio:ColorSpace, "" if absent */
    bool has_latlon, has_altitude;
    double latitude_deg, longitude_deg, altitude_m; /* signs and references applied */
    double exposure_s, iso, f_number, focal_mm, focal_35mm; /* NaN if absent */
    char datetime[40], subsec[16];    /* Exif:DateTimeOriginal */
    char make[64], model[64];
} cn_oiio_info;
CN_NODISCARD cn_status cn_oiio_read_info(const char *path, cn_oiio_info *info);
/* Decodes to RGBA floats (grey is spread; missing alpha is 1) with the orientation applied: width*height*4 floats, malloc'ed, caller frees.
 * Truncated files are CN_ERR_FORMAT. Values as stored (no colour conversion), integers to [0,1]. */
CN_NODISCARD cn_status cn_oiio_read_rgba(const char *path, float **rgba, uint32_t *width, uint32_t *height);
/* Attributes for writing; name NULL ends the list. */
typedef struct cn_oiio_attribute { const char *name; const char *text; const double *numbers; int n_numbers; } cn_oiio_attribute;
/* 8-bit PNG from RGB or RGBA floats in [0,1]. Written under a temporary name and renamed. */
CN_NODISCARD cn_status cn_oiio_write_png(const char *path, const float *pixels, uint32_t width, uint32_t height, int channels,
                                         const cn_oiio_attribute *attributes);
/* JPEG at quality 95 from RGB floats in [0,1]; EXIF and GPS attributes are kept. */
CN_NODISCARD cn_status cn_oiio_write_jpeg(const char *path, const float *rgb, uint32_t width, uint32_t height,
                                          const cn_oiio_attribute *attributes);
/* EXR: half R,G,B,A in linear ACEScg (chromaticities written) and float Z depth (may be NULL). */
CN_NODISCARD cn_status cn_oiio_write_exr(const char *path, const float *rgba, const float *depth, uint32_t width, uint32_t height,
                                         const cn_oiio_attribute *attributes);

#ifdef __cplusplus
}
#endif
#endif
