/* conurb/geo.h: where the local frame lies on Earth. Axes: x east, y north, z up, in metres, as doubles. Every
 * function may be called from any thread. */
#ifndef CONURB_GEO_H
#define CONURB_GEO_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

/* A local east-north-up frame, and the transform that brought the poses into it: local = scale * rotation * source +
 * translation. source is the frame of the program that made the poses. */
typedef struct cn_frame {
    bool georeferenced; /* false: no GPS; local is the source frame, and neither its unit nor its north is known */
    double latitude_deg, longitude_deg, height_m; /* the origin, WGS84 */
    bool geoid_applied;    /* heights are above the ellipsoid: given so, or converted by EGM96; false: above the sea */
    double geoid_height_m; /* EGM96 undulation at the origin: height of the geoid above the ellipsoid; 0 when unknown */
    double scale, rotation[9], translation[3];         /* row-major */
    double residual_horizontal_m, residual_vertical_m; /* RMS distance of camera centres from their GPS, inliers only */
    uint32_t n_gps, n_inliers;
    bool nadir_ambiguous; /* near-nadir photos of flat ground: focal length and flying height cannot be separated */
} cn_frame;

/* Sets the identity frame, without georeference. */
CN_API void cn_frame_init(cn_frame *frame);
/* The unit of lengths, for messages: "m", or "units" (of the poses) without georeference. */
CN_API const char *cn_frame_unit(const cn_frame *frame);
/* Convert between local metres and latitude, longitude (degrees), ellipsoidal height (metres). CN_ERR_DATA: the frame
 * has no georeference, or the coordinate is not on Earth (|latitude| > 90, NaN). */
CN_API CN_NODISCARD cn_status cn_frame_to_geodetic(const cn_frame *frame, const double local_m[3], double lat_lon_h[3]);
CN_API CN_NODISCARD cn_status cn_frame_from_geodetic(const cn_frame *frame, const double lat_lon_h[3],
                                                     double local_m[3]);
/* The matrix from local metres to Earth-centred, Earth-fixed metres (WGS84, EPSG:4978), column-major, for a frame with
 * georeference. */
CN_API void cn_frame_ecef(const cn_frame *frame, double ecef_from_local[16]);
/* A place as MGRS text with `precision` digits per coordinate: 0 to 5, where 5 is 1 m; else CN_ERR_USAGE. */
CN_API CN_NODISCARD cn_status cn_geo_mgrs(double latitude_deg, double longitude_deg, int precision, char out[32]);
/* The EPSG code of a place's UTM zone zz: 326zz in the north, 327zz in the south; UPS near the poles (32661, 32761). */
CN_API CN_NODISCARD cn_status cn_geo_utm_epsg(double latitude_deg, double longitude_deg, int *epsg);
/* The EGM96 undulation in metres: ellipsoidal height = height above sea level + undulation. Read from PROJ's
 * egm96_15.gtx, never over the network. When that grid is not installed: CN_OK, *found false, *height_m 0. */
CN_API CN_NODISCARD cn_status cn_geo_geoid_height(double latitude_deg, double longitude_deg, double *height_m,
                                                  bool *found);
/* Write and read frame.json. The file is replaced atomically. CN_ERR_VERSION: a newer Conurb made it. CN_ERR_FORMAT:
 * it is damaged; the message names the key. */
CN_API CN_NODISCARD cn_status cn_frame_save(const cn_frame *frame, const char *path);
/* Writes the frame beside an export: for F.ply, F.obj, F.glb, F.las, F.spz and F.chan as F.frame.json. */
CN_API CN_NODISCARD cn_status cn_frame_save_beside(const cn_frame *frame, const char *path);
CN_API CN_NODISCARD cn_status cn_frame_load(cn_frame *frame, const char *path);

#ifdef __cplusplus
}
#endif
#endif
