/* conurb/photo.h: the index of a photo collection, and its pixels at a working width. */
#ifndef CONURB_PHOTO_H
#define CONURB_PHOTO_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_photo {
    char *name;             /* path relative to the photo folder, with '/' */
    uint32_t width, height; /* pixels, after EXIF orientation is applied */
    uint8_t orientation;    /* EXIF orientation of the file, 1 to 8 */
    bool has_gps;
    double latitude_deg, longitude_deg;
    bool has_altitude;
    double altitude_m;     /* metres above sea level, from EXIF; negative below (reference 1) */
    double gps_sigma_m[3]; /* standard deviation of the GPS to the east, to the north and upwards, metres, where the
                              photo states it (RTK: XMP of DJI or Pix4D's namespace; GPSHPositioningError); else 0 */
    double time_s;         /* seconds since 1970, from EXIF DateTimeOriginal with subseconds. In UTC when the photo has
                              OffsetTimeOriginal; else the camera's clock is taken as UTC. NaN if absent */
    double exposure_s, iso, f_number; /* NaN if absent or 0/0 */
    double focal_mm, focal_35mm;      /* NaN if absent */
    double focal_px;      /* exact, of a pinhole picture that was cut out of another; else 0. Not kept in photos.json */
    bool deep;            /* samples of more than 8 bits */
    bool equirectangular; /* shows all directions: XMP GPano:ProjectionType says so */
    char *camera;         /* "make model", "" if absent */
    char *mask;   /* path of the mask, relative to the photo folder, or NULL: masks/NAME.png, NAME with or without the
                     photo's extension. It has the photo's aspect ratio, upright as the photo is shown or as its
                     pixels are stored (EXIF orientations 5 to 8); black pixels are ignored */
    char *depth;  /* path of the depth map, or NULL; set by cn_photo_index_find_maps, not kept in photos.json */
    char *normal; /* path of the normal map, or NULL; as depth */
    uint8_t normal_axes; /* cn_normal_axes of the normal map */
    uint64_t hash;       /* hash of the file's bytes */
} cn_photo;

typedef struct cn_photo_reject {
    char *name, *reason;
} cn_photo_reject;

typedef struct cn_photo_index {
    char *folder;     /* absolute */
    cn_photo *photos; /* sorted by name */
    uint32_t n_photos;
    cn_photo_reject *rejects; /* photos that are not used, with the reason: truncated, unreadable, duplicate */
    uint32_t n_rejects;
    uint32_t n_gps;
} cn_photo_index;

/* The library changes no setting of OpenImageIO. OpenEXR starts a thread for each processor when the first EXR file is
 * read. A program that uses OpenImageIO only through Conurb may call this once, before anything else: neither library
 * then starts threads of its own.
 *
 * The library does change exiv2. It replaces exiv2's log handler: the new one drops messages about Conurb's own calls
 * and passes the others to the handler that was set before. It gives exiv2's XMP parser a lock when that has none. It
 * lets exiv2 read HEIC and AVIF. */
CN_API void cn_photo_own_process(void);
/* Scans `folder` with its subfolders, except masks/, folders of a city, names that begin with a dot and, where `folder`
 * is that of a city, the folders that Conurb writes there. Decodes every photo once, on the pool, to find damaged ones.
 * Among photos with equal bytes, the first by name is kept. GPS that is not a place on Earth is ignored. The caller
 * frees the index with cn_photo_index_deinit; on failure it is empty. CN_ERR_DATA: no photo can be used. CN_ERR_IO: the
 * folder cannot be read. CN_ERR_INTERRUPTED: asked to stop. */
CN_API CN_NODISCARD cn_status cn_photo_index_scan(const cn_context *ctx, const char *folder, cn_photo_index *index);
CN_API void cn_photo_index_deinit(cn_photo_index *index);
/* Write and read photos.json. CN_ERR_FORMAT: the file is damaged; the message names the key. CN_ERR_VERSION: a newer
 * Conurb made it. */
CN_API CN_NODISCARD cn_status cn_photo_index_save(const cn_photo_index *index, const char *path);
CN_API CN_NODISCARD cn_status cn_photo_index_load(cn_photo_index *index, const char *path);
/* Depth maps of the photos, from a depth camera or from a neural network. */
typedef enum cn_depth_kind {
    CN_DEPTH_MEASURED, /* metres */
    CN_DEPTH_CUE       /* depth up to an unknown scale and shift per photo (Yu et al. 2022, "MonoSDF") */
} cn_depth_kind;
typedef enum cn_depth_along { CN_DEPTH_ALONG_AXIS, CN_DEPTH_ALONG_RAY } cn_depth_along;
/* The axes that a normal map is in, all of the camera: x right, y up, z back (OpenGL, Blender, nerfstudio), or x right,
 * y down, z forward (OpenCV, COLMAP). */
typedef enum cn_normal_axes { CN_NORMAL_OPENGL, CN_NORMAL_OPENCV } cn_normal_axes;
typedef struct cn_photo_maps {
    char *depth; /* folder with NAME.png or NAME.exr, NAME with or without the photo's extension; NULL: none */
    cn_depth_kind kind;
    cn_depth_along along; /* what depth is measured along; depth cameras: the camera's axis */
    char *normal;         /* folder of normal maps, named like depth maps; NULL: none */
    cn_normal_axes normal_axes;
} cn_photo_maps;
/* Sets `depth` of each photo that has a depth map: a 16-bit PNG in millimetres, or an EXR in metres. Values that are
 * 0, negative or not finite are missing. Sets `normal` of each photo that has a normal map: a PNG of 8 or 16 bits,
 * whose value v in [0, 1] means the component 2 v - 1, or an EXR of the components. A pixel is missing where alpha is
 * 0, where a value is not finite, where an EXR's normal has length 0, and where a PNG's has a length below 0.5 or
 * above 1.5 (black). *n: number of photos with a map of any kind. The maps are read and checked later, when the pixel
 * store is built. CN_ERR_DATA: no photo has a depth map, or none has a normal map, though a folder is given. */
CN_API CN_NODISCARD cn_status cn_photo_index_find_maps(cn_photo_index *index, const cn_photo_maps *maps, uint32_t *n);
/* The index of the photo with that name, or -1. A file name without its folder is enough when it is unique. */
CN_API int64_t cn_photo_index_find(const cn_photo_index *index, const char *name);
/* The photo's exposure in stops: log2(exposure_s * ISO / 100 / f_number^2). A missing ISO counts as 100, a missing
 * f-number as 1. NaN when exposure_s is missing. */
CN_API double cn_photo_exposure_ev(const cn_photo *photo);

/* The pixel store: one file per city, with every photo at the working width. A pixel is 4 half floats: R, G, B in
 * linear ACEScg, and a weight in [0, 1]. Rows run top down, photos are in index order, and each starts on a 4096-byte
 * boundary. Pixels are read from the file when they are needed, so memory does not grow with the number of photos.
 *
 * Colours are converted by the photo's ICC profile. sRGB, Display P3, Adobe RGB (1998), ProPhoto and Rec. 2020 are
 * recognised by their primaries and curve and converted by Conurb's own colour config; other RGB and grey profiles by
 * Little CMS (relative colorimetric). Without a profile, integer photos are Adobe RGB when EXIF says so, else sRGB;
 * float photos are linear sRGB, unless their chromaticities are those of ACEScg or ACES2065-1.
 *
 * The weight is 0 where the mask is black, where alpha is 0, where a pixel is not finite, and in a border of one colour
 * that was put around a photo on both sides. */
typedef struct cn_pixel_store cn_pixel_store;
typedef struct cn_pixel_extent {
    uint32_t width, height;
} cn_pixel_extent;

/* Builds or completes the store at `path`. Photos that are in it already, with the same hash, mask and size, are not
 * decoded again. The old store stays until the new one is complete. When asked to stop, the work so far is kept in
 * `path`.part, and the next call resumes from it. width_px: working width, 16 to 65535; narrower photos keep their
 * size. Memory: 16 bytes per pixel of one full-size photo for each thread. An ICC profile that cannot be used is
 * logged once per camera, and the photo is read as one without a profile. CN_ERR_CONFIG: width_px. CN_ERR_IO: the
 * store cannot be written. CN_ERR_FORMAT, CN_ERR_DATA: a photo or mask cannot be used. CN_ERR_INTERRUPTED: asked to
 * stop. */
CN_API CN_NODISCARD cn_status cn_pixel_store_build(const cn_context *ctx, const cn_photo_index *index,
                                                   uint32_t width_px, const char *path);
/* Opens a store. The caller closes it. An open store may be read by several threads at the same time. CN_ERR_IO: there
 * is no such file. CN_ERR_FORMAT: it is damaged. CN_ERR_VERSION: a newer Conurb made it. */
CN_API CN_NODISCARD cn_status cn_pixel_store_open(cn_pixel_store **store, const char *path);
CN_API void cn_pixel_store_close(cn_pixel_store **store);
CN_API uint32_t cn_pixel_store_count(const cn_pixel_store *store);
CN_API const char *cn_pixel_store_name(const cn_pixel_store *store, uint32_t photo);
CN_API cn_pixel_extent cn_pixel_store_extent(const cn_pixel_store *store, uint32_t photo);
/* Reads n pixels: (photo[i], x[i], y[i]) into rgbw[4 * i]. CN_ERR_IO: the file cannot be read. CN_ERR_INTERNAL: an
 * index is out of range. */
CN_API CN_NODISCARD cn_status cn_pixel_store_gather(const cn_pixel_store *store, size_t n, const uint32_t *photo,
                                                    const uint16_t *x, const uint16_t *y, float *rgbw);
/* Depth maps at the working width, resampled to the nearest value. depth_m[i]: metres; 0 where the map has no value.
 * Errors as above. */
CN_API bool cn_pixel_store_has_depth(const cn_pixel_store *store, uint32_t photo);
CN_API CN_NODISCARD cn_status cn_pixel_store_gather_depth(const cn_pixel_store *store, size_t n, const uint32_t *photo,
                                                          const uint16_t *x, const uint16_t *y, float *depth_m);
/* Normal maps at the working width, resampled to the nearest value. normal[3 * i]: unit length to 0.01, in the axes of
 * cn_camera (x right, y down, z forward); 0, 0, 0 where the map has no value. Errors as above. */
CN_API bool cn_pixel_store_has_normal(const cn_pixel_store *store, uint32_t photo);
CN_API CN_NODISCARD cn_status cn_pixel_store_gather_normal(const cn_pixel_store *store, size_t n, const uint32_t *photo,
                                                           const uint16_t *x, const uint16_t *y, float *normal);
/* Reads a whole photo into the caller's buffer of height * width * 4 floats. Errors as above. */
CN_API CN_NODISCARD cn_status cn_pixel_store_read(const cn_pixel_store *store, uint32_t photo, float *rgbw);

#ifdef __cplusplus
}
#endif
#endif
