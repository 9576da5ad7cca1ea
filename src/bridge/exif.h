/* What EXIF says of a photo. Two libraries fill it: exiv2, and OpenImageIO for what exiv2 does not know. */
#ifndef CONURB_BRIDGE_EXIF_H
#define CONURB_BRIDGE_EXIF_H
#include "conurb/base.h"

typedef struct cn_exif {
    bool has_latlon, has_altitude;
    bool has_bad_gps; /* position tags are there, but they are no place on Earth (NaN, latitude 95) */
    double latitude_deg, longitude_deg, altitude_m;         /* signs and references applied */
    double exposure_s, iso, f_number, focal_mm, focal_35mm; /* NaN if absent, zero or 0/0 */
    char datetime[40], subsec[16], offset[16];              /* DateTimeOriginal and its companions; "" if absent */
    char make[64], model[64];
    bool is_adobe_rgb; /* ColorSpace is "uncalibrated" and the interoperability index R03 */
} cn_exif;
#endif
