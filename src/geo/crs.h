/* Coordinate systems by name, through PROJ. Never over the network. */
#ifndef CONURB_GEO_CRS_H
#define CONURB_GEO_CRS_H
#include "conurb/base.h"

/* What heights are measured from. A coordinate system with a vertical part of its own decides it itself. */
typedef enum cn_heights { CN_HEIGHTS_ELLIPSOID, CN_HEIGHTS_SEA_LEVEL } cn_heights;

/* n places (x, y, z) in a coordinate system become latitude and longitude of WGS84 in degrees and the height above its
 * ellipsoid, in place. x is east or longitude, y north or latitude, whatever order the system itself has. A height of
 * NaN stays NaN.
 * crs: "EPSG:25832", "EPSG:25832+7837", a PROJ string ("+proj=utm +zone=32 ..."), "WGS84", or "WGS84 UTM 32N", as ODM
 * writes them. Heights above sea level are converted by EGM96, also those of a vertical part whose own grid is not
 * installed; *by_egm96 tells it. Other heights are taken as those above WGS84's ellipsoid, without change. CN_ERR_DATA:
 * PROJ does not know the system, or a place is not in it. */
CN_NODISCARD cn_status cn_crs_to_wgs84(const char *crs, cn_heights heights, size_t n, double (*places)[3],
                                       bool *by_egm96);
#endif
