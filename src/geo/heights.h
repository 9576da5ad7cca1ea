/* What heights in a frame are measured from. */
#ifndef CONURB_GEO_HEIGHTS_H
#define CONURB_GEO_HEIGHTS_H
#include "conurb/geo.h"

/* Of a frame with georeference, to follow a height: "above the WGS84 ellipsoid" or how the photos' GPS has it. */
const char *cn_frame_heights(const cn_frame *frame);
#endif
