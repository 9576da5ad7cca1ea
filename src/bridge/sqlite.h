/* Reads COLMAP's database, and writes matches into it. One thread at a time, and not while COLMAP writes. */
#ifndef CONURB_BRIDGE_SQLITE_H
#define CONURB_BRIDGE_SQLITE_H
#include "conurb/base.h"

typedef struct cn_colmap_database cn_colmap_database;

/* CN_ERR_FORMAT when the file is no database, is damaged, or lacks COLMAP's tables. */
CN_NODISCARD cn_status cn_colmap_database_open(cn_colmap_database **database, const char *path);
void cn_colmap_database_close(cn_colmap_database **database);
/* *camera: number of the camera of the photo of this name; 0 when the database has no such photo. */
CN_NODISCARD cn_status cn_colmap_database_camera(cn_colmap_database *database, const char *name, uint32_t *camera);

/* ---- Features and matches. Photos have COLMAP's numbers, above 0. ---- */
enum { CN_COLMAP_DESCRIPTOR = 128 }; /* bytes */

/* *photo: the number of the photo of this name; 0 when the database has no such photo. */
CN_NODISCARD cn_status cn_colmap_database_photo(cn_colmap_database *database, const char *name, uint32_t *photo);
/* The n descriptors of a photo, one after the other; *data is NULL when there are none. The caller frees it.
 * CN_ERR_FORMAT: they are not as many as the database says. */
CN_NODISCARD cn_status cn_colmap_database_descriptors(cn_colmap_database *database, uint32_t photo, uint8_t **data,
                                                      uint32_t *n);
/* The scales in pixels of a photo's n features, in the order of the descriptors; 1 where the database has none. The
 * caller frees *scale, also after a failure. CN_ERR_FORMAT: there are not n of them. */
CN_NODISCARD cn_status cn_colmap_database_scales(cn_colmap_database *database, uint32_t photo, uint32_t n,
                                                 float **scale);
/* *n: number of features of a photo. */
CN_NODISCARD cn_status cn_colmap_database_count(cn_colmap_database *database, uint32_t photo, uint32_t *n);
/* Places of a photo's n features in pixels, x and y of each, in the order of the descriptors; *xy is NULL when there
 * are none. The caller frees it. CN_ERR_FORMAT: they are not as many as the database says. */
CN_NODISCARD cn_status cn_colmap_database_places(cn_colmap_database *database, uint32_t photo, float (**xy)[2],
                                                 uint32_t *n);
/* A camera as it was before any adjustment. */
typedef struct cn_colmap_camera {
    int lens; /* COLMAP's number of the model */
    uint32_t width, height;
    double params[8];
    bool has_focal; /* from EXIF; else it is COLMAP's guess */
} cn_colmap_camera;
/* CN_ERR_FORMAT: there is no such camera, or its parameters are damaged. */
CN_NODISCARD cn_status cn_colmap_database_lens(cn_colmap_database *database, uint32_t camera, cn_colmap_camera *out);
/* What verification found of a pair of photos. */
typedef enum cn_colmap_config {
    CN_COLMAP_CALIBRATED = 2,
    CN_COLMAP_UNCALIBRATED = 3,
    CN_COLMAP_PLANAR = 4,
    CN_COLMAP_PANORAMIC = 5,
    CN_COLMAP_PLANAR_OR_PANORAMIC = 6
} cn_colmap_config;
typedef struct cn_colmap_geometry {
    int config;
    uint32_t (*pairs)[2]; /* features of a and of b that are the same; the caller frees them */
    uint32_t n;
    bool has_e, has_f;
    double e[9], f[9]; /* essential and fundamental matrix, row-major: b' e a = 0 */
} cn_colmap_geometry;
/* a < b. Empty when the pair was not verified. CN_ERR_FORMAT: it is damaged. */
CN_NODISCARD cn_status cn_colmap_database_geometry(cn_colmap_database *database, uint32_t a, uint32_t b,
                                                   cn_colmap_geometry *out);
/* Every pair with verified matches, and how many. The caller frees the list. */
typedef struct cn_colmap_verified {
    uint32_t a, b, n;
} cn_colmap_verified;
CN_NODISCARD cn_status cn_colmap_database_verified(cn_colmap_database *database, cn_colmap_verified **pairs, size_t *n);
/* What the database has of a pair of photos: matches (perhaps none), and COLMAP's verification of them. */
typedef struct cn_colmap_pair {
    bool matched, verified;
} cn_colmap_pair;
CN_NODISCARD cn_status cn_colmap_database_pair(cn_colmap_database *database, uint32_t a, uint32_t b,
                                               cn_colmap_pair *state);
/* Writes between begin and commit are kept together or not at all, also when the process is killed. */
CN_NODISCARD cn_status cn_colmap_database_begin(cn_colmap_database *database);
CN_NODISCARD cn_status cn_colmap_database_commit(cn_colmap_database *database);
void cn_colmap_database_rollback(cn_colmap_database *database);
/* Matches of photos a and b: pairs[i] are the indices of a feature of a and of one of b. They are stored as COLMAP
 * does, with the smaller number's photo first. */
typedef struct cn_colmap_pair_matches {
    uint32_t a, b, n;
    const uint32_t (*pairs)[2];
} cn_colmap_pair_matches;
CN_NODISCARD cn_status cn_colmap_database_write_matches(cn_colmap_database *database,
                                                        const cn_colmap_pair_matches *matches);
/* Writes what COLMAP writes for a pair with too few matches: none, and a verification that found nothing. */
CN_NODISCARD cn_status cn_colmap_database_write_unrelated(cn_colmap_database *database, uint32_t a, uint32_t b);
/* Makes OPENCV cameras SIMPLE_RADIAL, with the first focal length and no distortion, and leaves other cameras alone. */
CN_NODISCARD cn_status cn_colmap_database_simplify_cameras(cn_colmap_database *database);
#endif
