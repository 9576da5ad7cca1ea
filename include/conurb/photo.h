/* conurb/photo.h: the index of a photo collection, and its pixels at a working width. */
#ifndef CONURB_PHOTO_H
#define CONURB_PHOTO_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_photo {
    char *name;             /* path below the photo folder, '/' separated */
    uint32_t width, height; /* pixels, after EXIF orientation is applied */
    uint8_t orientation;    /* EXIF 1..8 as found in the file */
    bool has_gps;
    double latitude_deg, longitude_deg;
    bool has_altitude;
    double altitude_m; /* above sea level as EXIF has it; negative below (reference 1) */
    double time_s;     /* seconds since 1970 of EXIF DateTimeOriginal and its subseconds: UTC where the photo has
                        * OffsetTimeOriginal, else the camera's clock taken for UTC; NaN if absent */
    double exposure_s, iso, f_number; /* NaN if absent or 0/0 */
    double focal_mm, focal_35mm;      /* NaN if absent */
    char *camera;                     /* "make model", "" if absent */
    char *mask;    /* path below the photo folder of masks/NAME.png, NAME with or without the photo's ending
                    * (upright as the photo is shown; black is ignored), or NULL */
    char *depth;   /* path of the depth map, or NULL; cn_photo_index_find_maps sets it, photos.json does not have it */
    uint64_t hash; /* of the file's bytes */
} cn_photo;

typedef struct cn_photo_reject {
    char *name, *reason;
} cn_photo_reject;

typedef struct cn_photo_index {
    char *folder;     /* absolute */
    cn_photo *photos; /* sorted by name */
    uint32_t n_photos;
    cn_photo_reject *rejects; /* truncated, unreadable, duplicate: named, left out, counted */
    uint32_t n_rejects;
    uint32_t n_gps;
} cn_photo_index;

/* The library changes no setting of OpenImageIO. OpenEXR then starts as many threads as there are processors when a
 * first EXR is read. A program that uses OpenImageIO through Conurb alone calls this once, before anything else:
 * neither starts threads of its own then. exiv2's log handler is replaced by one that drops what exiv2 says of Conurb's
 * own calls and hands the rest to the handler that was set before; its XMP parser gets a lock, unless it has one. */
CN_API void cn_photo_own_process(void);
/* Scans `folder` (recursively; not its masks/ folder, nor names that begin with a dot) and decodes every photo
 * once on the pool to find damaged ones. Of photos with the same bytes the first by name stays. GPS that is no
 * place on Earth counts as none. CN_ERR_DATA when no photo is left, CN_ERR_IO when the folder cannot be read,
 * CN_ERR_INTERRUPTED when asked to stop. Caller frees with cn_photo_index_deinit; on failure the index is empty. */
CN_API CN_NODISCARD cn_status cn_photo_index_scan(const cn_context *ctx, const char *folder, cn_photo_index *index);
CN_API void cn_photo_index_deinit(cn_photo_index *index);
/* photos.json. Loading: CN_ERR_FORMAT names file and key, CN_ERR_VERSION when a newer Conurb made it. */
CN_API CN_NODISCARD cn_status cn_photo_index_save(const cn_photo_index *index, const char *path);
CN_API CN_NODISCARD cn_status cn_photo_index_load(cn_photo_index *index, const char *path);
/* Maps that lie beside the photos, from a depth camera or made by a network. */
typedef enum cn_depth_kind {
    CN_DEPTH_MEASURED, /* metres */
    CN_DEPTH_CUE       /* right but for a scale and a shift of each photo (Yu et al. 2022, "MonoSDF") */
} cn_depth_kind;
typedef enum cn_depth_along { CN_DEPTH_ALONG_AXIS, CN_DEPTH_ALONG_RAY } cn_depth_along;
typedef struct cn_photo_maps {
    char *depth; /* folder of DEPTH/NAME.png or .exr, NAME with or without the photo's ending; NULL: none */
    cn_depth_kind kind;
    cn_depth_along along; /* depth cameras measure along the camera's axis */
} cn_photo_maps;
/* Sets `depth` of each photo that has a depth map: 16-bit PNG in millimetres, or EXR in metres. 0, negative and
 * non-finite values are not measured. *n: how many photos have one. CN_ERR_DATA when none has. The files are read, and
 * checked, when the pixel store is built. */
CN_API CN_NODISCARD cn_status cn_photo_index_find_maps(cn_photo_index *index, const cn_photo_maps *maps, uint32_t *n);
/* Index of the photo of that name, or -1. A bare file name also matches when it is unique. */
CN_API int64_t cn_photo_index_find(const cn_photo_index *index, const char *name);
/* log2 of shutter * ISO / 100 / f^2: exposure in stops; NaN when shutter is missing
 * (missing ISO counts as 100, missing f-number as 1). */
CN_API double cn_photo_exposure_ev(const cn_photo *photo);

/* The pixel store: one file a city with every photo at the working width as linear ACEScg, 4 half floats a pixel
 * (R, G, B, weight in [0,1]), rows top down, photos in index order, each starting on a 4096-byte boundary. Colours
 * go by a photo's ICC profile: sRGB, Display P3, Adobe RGB (1998), ProPhoto and Rec. 2020, known by their primaries and
 * curve, through spaces of Conurb's own config, any other of RGB or grey through Little CMS (relative colorimetric).
 * Without one, integer photos are Adobe RGB where EXIF says so, else sRGB, and float ones linear sRGB unless their
 * chromaticities are those of ACEScg or ACES2065-1. Weight is 0 where the mask is black, where alpha is 0 and where a
 * pixel is not finite. Read by position, so memory does not grow with the number of photos. */
typedef struct cn_pixel_store cn_pixel_store;
typedef struct cn_pixel_extent {
    uint32_t width, height;
} cn_pixel_extent;

/* Makes or completes the store at `path`: photos already there, by hash, mask and size, are not decoded again, and
 * the old store stays until the new one is whole. When asked to stop (CN_ERR_INTERRUPTED) it keeps what is done in
 * `path`.part, and the next build takes it up. width_px (16 to 65535) is the working width; photos narrower than
 * it keep their size. Takes 16 bytes a pixel of one full-size photo for every thread. CN_ERR_CONFIG for width_px,
 * CN_ERR_IO when the store cannot be written, CN_ERR_FORMAT or CN_ERR_DATA for a mask or photo that cannot be
 * used. An ICC profile that cannot be used is logged once a camera, and the photo taken as one without. */
CN_API CN_NODISCARD cn_status cn_pixel_store_build(const cn_context *ctx, const cn_photo_index *index,
                                                   uint32_t width_px, const char *path);
/* CN_ERR_IO when it is not there, CN_ERR_FORMAT when damaged, CN_ERR_VERSION when newer. Caller closes. */
CN_API CN_NODISCARD cn_status cn_pixel_store_open(cn_pixel_store **store, const char *path);
CN_API void cn_pixel_store_close(cn_pixel_store **store);
CN_API uint32_t cn_pixel_store_count(const cn_pixel_store *store);
CN_API const char *cn_pixel_store_name(const cn_pixel_store *store, uint32_t photo);
CN_API cn_pixel_extent cn_pixel_store_extent(const cn_pixel_store *store, uint32_t photo);
/* Reads n pixels: (photo[i], x[i], y[i]) -> rgbw[4*i]. Thread-safe. CN_ERR_IO, or CN_ERR_INTERNAL out of range. */
CN_API CN_NODISCARD cn_status cn_pixel_store_gather(const cn_pixel_store *store, size_t n, const uint32_t *photo,
                                                    const uint16_t *x, const uint16_t *y, float *rgbw);
/* Depth maps at the working width (nearest value): depth_m[i] is 0 where nothing was measured. Errors as above. */
CN_API bool cn_pixel_store_has_depth(const cn_pixel_store *store, uint32_t photo);
CN_API CN_NODISCARD cn_status cn_pixel_store_gather_depth(const cn_pixel_store *store, size_t n, const uint32_t *photo,
                                                          const uint16_t *x, const uint16_t *y, float *depth_m);
/* Reads a whole photo as width*height*4 floats into the caller's buffer. */
CN_API CN_NODISCARD cn_status cn_pixel_store_read(const cn_pixel_store *store, uint32_t photo, float *rgbw);

#ifdef __cplusplus
}
#endif
#endif
