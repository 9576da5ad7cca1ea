/* A C interface of GeographicLib: WGS84 only, degrees and metres. Any thread. No exception leaves it. */
#ifndef CONURB_BRIDGE_GEOGRAPHICLIB_H
#define CONURB_BRIDGE_GEOGRAPHICLIB_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

/* Latitude, longitude, ellipsoidal height <-> east, north, up about an origin.
 * CN_ERR_DATA for a coordinate that is not on Earth (|lat| > 90, NaN, infinite). */
CN_NODISCARD cn_status cn_geographic_forward(const double origin[3], const double lat_lon_h[3], double local_m[3]);
CN_NODISCARD cn_status cn_geographic_reverse(const double origin[3], const double local_m[3], double lat_lon_h[3]);
/* MGRS text, precision 0..5 digits a coordinate. */
CN_NODISCARD cn_status cn_geographic_mgrs(double latitude_deg, double longitude_deg, int precision, char out[32]);
/* The standard UTM zone 1..60 (with the exceptions for Norway and Svalbard), 0 for UPS near the poles. */
CN_NODISCARD cn_status cn_geographic_utm_zone(double latitude_deg, double longitude_deg, int *zone, bool *north);

#ifdef __cplusplus
}
#endif
#endif
