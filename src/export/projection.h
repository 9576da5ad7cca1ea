/* Places of the local frame in the coordinate system of the exports: the UTM zone of the frame's origin (UPS near the
 * poles), or local metres without georeference. */
#ifndef CONURB_EXPORT_PROJECTION_H
#define CONURB_EXPORT_PROJECTION_H
#include "conurb/geo.h"

typedef struct cn_projection {
    const cn_frame *frame;
    int epsg;                          /* 0: local metres */
    void *to_geodetic, *from_geodetic; /* OGRCoordinateTransformationH */
} cn_projection;

/* Borrows the frame. CN_ERR_TOOL: PROJ's database lacks the zone. */
CN_NODISCARD cn_status cn_projection_init(cn_projection *projection, const cn_frame *frame);
void cn_projection_deinit(cn_projection *projection); /* fine when zeroed */
/* Easting, northing and height of a local point. The height is above the ellipsoid when the frame's geoid was applied;
 * without georeference all three are the local coordinates. CN_ERR_DATA: the point is not in the zone's domain. */
CN_NODISCARD cn_status cn_projection_forward(const cn_projection *projection, const double local_m[3], double xyh[3]);
/* The local point at an easting, a northing and a height. CN_ERR_DATA. */
CN_NODISCARD cn_status cn_projection_inverse(const cn_projection *projection, const double xyh[3], double local_m[3]);
/* A coordinate system as WKT 1 (OGC 01-009). The caller frees *wkt with free(). CN_ERR_TOOL. */
CN_NODISCARD cn_status cn_epsg_wkt(int epsg, char **wkt);
/* What heights are measured from, as a sentence for a file's metadata. */
void cn_projection_heights(const cn_frame *frame, char text[160]);
#endif
