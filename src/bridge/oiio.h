/* A C interface of OpenImageIO. Buffers are the caller's. Any thread. */
#ifndef CONURB_BRIDGE_OIIO_H
#define CONURB_BRIDGE_OIIO_H
#include "bridge/exif.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_oiio_info {
    uint32_t width, height, channels; /* as stored */
    int orientation;                  /* EXIF 1..8, 1 if absent */
    bool is_float;                    /* half or float samples: already linear */
    bool is_deep;                     /* samples of more than 8 bits */
    char colour_space[64];            /* "ACEScg" or "ACES2065-1" by chromaticities, else oiio:ColorSpace or "" */
    cn_exif exif;                     /* without offset, and rationals have 24 bits only; cn_exiv2_read is exact */
} cn_oiio_info;
/* Settings of the whole process: OpenImageIO and OpenEXR start no threads of their own. Nothing else here sets any. */
void cn_oiio_own_process(void);
/* CN_ERR_IO: there is no such file. CN_ERR_FORMAT: it is not a picture. */
CN_NODISCARD cn_status cn_oiio_read_info(const char *path, cn_oiio_info *info);
/* The bytes of the file's ICC profile, malloc'ed, caller frees; NULL when it has none. Fails as cn_oiio_read_info. */
CN_NODISCARD cn_status cn_oiio_read_icc(const char *path, void **profile, size_t *size);
/* Decodes the whole picture in bands, only to check it. CN_ERR_FORMAT: it is truncated or damaged. The size is that
 * after orientation. */
CN_NODISCARD cn_status cn_oiio_check(const char *path, uint32_t *width, uint32_t *height);
/* Decodes to RGBA floats (grey is spread; missing alpha is 1) with the orientation applied: width*height*4 floats,
 * malloc'ed, caller frees; NULL on failure. Truncated files are CN_ERR_FORMAT. Values as stored (no colour conversion,
 * alpha not multiplied in), integers to [0,1]. */
CN_NODISCARD cn_status cn_oiio_read_rgba(const char *path, float **rgba, uint32_t *width, uint32_t *height);
/* Reads a map of a photo: distances (1 channel: the one named Z or depth, else the first) or directions (the first 3
 * channels). Values are as stored, integers scaled to [0,1], with the orientation applied. The caller frees values
 * with free(). */
typedef struct cn_oiio_map {
    float *values;
    uint32_t width, height;
    int bits; /* bits of an integer; 0: half or float */
} cn_oiio_map;
/* CN_ERR_FORMAT when the file is damaged, or has fewer channels. */
CN_NODISCARD cn_status cn_oiio_read_map(const char *path, uint32_t channels, cn_oiio_map *map);
/* Attributes to write; name NULL ends the list. A text or, when text is NULL, numbers (written as floats). */
typedef struct cn_oiio_attribute {
    const char *name, *text;
    const double *numbers;
    int n_numbers;
} cn_oiio_attribute;
/* All writers write to a temporary name and rename; on failure (CN_ERR_IO) the old file stays. */
/* 8-bit PNG from RGB or RGBA floats in [0,1], clamped. */
CN_NODISCARD cn_status cn_oiio_write_png(const char *path, const float *pixels, uint32_t width, uint32_t height,
                                         int channels, const cn_oiio_attribute *attributes);
/* JPEG at quality 95 from RGB floats in [0,1]; EXIF and GPS attributes are kept. */
CN_NODISCARD cn_status cn_oiio_write_jpeg(const char *path, const float *rgb, uint32_t width, uint32_t height,
                                          const cn_oiio_attribute *attributes);
/* Copies a picture to a JPEG of 8 bits, for programs that cannot read the original. The pixels stay in the order of the
 * file: no orientation is applied. Linear light (half and float) is scaled, so that its brightest hundredth is white,
 * and sRGB-encoded. Alpha is left out. CN_ERR_FORMAT: `from` is damaged. CN_ERR_IO: `to` cannot be written. */
CN_NODISCARD cn_status cn_oiio_copy_as_jpeg(const char *from, const char *to, const cn_oiio_attribute *attributes);
/* 8-bit PNG, or JPEG of that quality (1 to 100). */
typedef struct cn_oiio_encoding {
    bool jpeg;
    int quality;      /* of a JPEG */
    bool full_chroma; /* of a JPEG: colours at full size, not at half */
} cn_oiio_encoding;
/* Encodes a picture in memory, from RGB floats in [0,1], clamped. *bytes: caller frees; NULL on failure. */
CN_NODISCARD cn_status cn_oiio_encode(cn_oiio_encoding encoding, const float *rgb, uint32_t width, uint32_t height,
                                      uint8_t **bytes, size_t *size);
/* The same from bytes, display-encoded. */
CN_NODISCARD cn_status cn_oiio_encode_bytes(cn_oiio_encoding encoding, const uint8_t *rgb, uint32_t width,
                                            uint32_t height, uint8_t **bytes, size_t *size);
/* 16-bit TIFF from RGB floats in [0,1]; EXIF attributes are kept. */
CN_NODISCARD cn_status cn_oiio_write_tiff(const char *path, const float *rgb, uint32_t width, uint32_t height,
                                          const cn_oiio_attribute *attributes);
/* EXR: half R,G,B,A in linear ACEScg (chromaticities written) and float Z depth (may be NULL). Colours past half's
 * range are written as 65504. */
CN_NODISCARD cn_status cn_oiio_write_exr(const char *path, const float *rgba, const float *depth, uint32_t width,
                                         uint32_t height, const cn_oiio_attribute *attributes);
/* The same with further float channels, such as "normal.X"; a NULL name ends them. Pixel i is values[i * stride]. */
typedef struct cn_oiio_channel {
    const char *name;
    const float *values;
    size_t stride;
} cn_oiio_channel;
typedef struct cn_oiio_exr {
    const float *rgba, *depth;
    uint32_t width, height;
    const cn_oiio_channel *channels; /* NULL: none */
} cn_oiio_exr;
CN_NODISCARD cn_status cn_oiio_write_exr_layers(const char *path, const cn_oiio_exr *exr,
                                                const cn_oiio_attribute *attributes);

#ifdef __cplusplus
}
#endif
#endif
