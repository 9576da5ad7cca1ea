/* The geoid at many places at once. */
#ifndef CONURB_GEO_GEOID_H
#define CONURB_GEO_GEOID_H
#include "conurb/geo.h"

#define CN_GEOID_GRID "egm96_15.gtx"

/* height_m[i] = undulation of `grid` (a file that PROJ finds, never one from the network) at latitude_deg[i],
 * longitude_deg[i]: ellipsoidal height = height above sea level + undulation. *found false and height_m all 0 when the
 * grid is not installed. Any thread; loads the grid once a call. */
CN_NODISCARD cn_status cn_geoid_heights(const char *grid, size_t n, const double *latitude_deg,
                                        const double *longitude_deg, double *height_m, bool *found);
#endif
