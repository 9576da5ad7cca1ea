/* conurb/geo.h: where the local metres are on Earth. Axes: x east, y north, z up. Doubles. */
#ifndef CONURB_GEO_H
#define CONURB_GEO_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

/* A local east-north-up frame and how the poses were brought into it.
 * local = scale * rotation * source + translation, where source is the pose maker's frame. */
typedef struct cn_frame {
    bool georeferenced; /* false: no GPS; local is the source frame, without true metres or north */
    double latitude_deg, longitude_deg, height_m; /* WGS84, ellipsoidal height of the origin */
    bool geoid_applied;                           /* EXIF altitudes were above sea level and EGM96 was installed */
    double geoid_height_m; /* EGM96 undulation at the origin (ellipsoid + undulation = sea level), 0 if unknown */
    double scale, rotation[9], translation[3];         /* row-major */
    double residual_horizontal_m, residual_vertical_m; /* rms of camera centres against GPS, inliers */
    uint32_t n_gps, n_inliers;
    bool nadir_ambiguous; /* focal length and height cannot be told apart */
} cn_frame;

/* Every function here is for any thread. */

/* Identity frame without georeference. */
CN_API void cn_frame_init(cn_frame *frame);
/* What lengths are in, for messages: "m", or "units" (of the poses) where there is no georeference. */
CN_API const char *cn_frame_unit(const cn_frame *frame);
/* Local metres <-> latitude, longitude (degrees), ellipsoidal height (metres).
 * CN_ERR_DATA when the frame has no georeference or the coordinate is not on Earth (|lat| > 90, NaN). */
CN_API CN_NODISCARD cn_status cn_frame_to_geodetic(const cn_frame *frame, const double local_m[3], double lat_lon_h[3]);
CN_API CN_NODISCARD cn_status cn_frame_from_geodetic(const cn_frame *frame, const double lat_lon_h[3],
                                                     double local_m[3]);
/* MGRS text, NUL-terminated, at `precision` digits a coordinate (0..5: 5 is 1 m; else CN_ERR_USAGE). */
CN_API CN_NODISCARD cn_status cn_geo_mgrs(double latitude_deg, double longitude_deg, int precision, char out[32]);
/* UTM zone as an EPSG code: 326zz north, 327zz south; UPS for the poles (32661, 32761). */
CN_API CN_NODISCARD cn_status cn_geo_utm_epsg(double latitude_deg, double longitude_deg, int *epsg);
/* EGM96 undulation in metres: ellipsoidal height = height above sea level + undulation. From PROJ's egm96_15.gtx, never
 * over the network. *found false, *height_m 0 (and CN_OK) when the grid is not installed. */
CN_API CN_NODISCARD cn_status cn_geo_geoid_height(double latitude_deg, double longitude_deg, double *height_m,
                                                  bool *found);
/* frame.json, atomically. A newer version is CN_ERR_VERSION, a damaged file CN_ERR_FORMAT naming the key. */
CN_API CN_NODISCARD cn_status cn_frame_save(const cn_frame *frame, const char *path);
CN_API CN_NODISCARD cn_status cn_frame_load(cn_frame *frame, const char *path);

#ifdef __cplusplus
}
#endif
#endif
