/* The EXIF of a photo. exiv2 fills it; OpenImageIO does for file formats that exiv2 cannot read. */
#ifndef CONURB_BRIDGE_EXIF_H
#define CONURB_BRIDGE_EXIF_H
#include "conurb/base.h"

typedef struct cn_exif {
    bool has_latlon, has_altitude;
    bool has_bad_gps; /* there are GPS tags, but not of a place where a camera can be (cn_exif_is_place) */
    double latitude_deg, longitude_deg, altitude_m; /* signs and references applied */
    /* Standard deviation of the position to the east, to the north and upwards, metres; 0: not stated. From XMP of
     * DJI and of Pix4D's namespace, which several makers write, or from EXIF's GPSHPositioningError. */
    double gps_sigma_m[3];
    double exposure_s, iso, f_number, focal_mm, focal_35mm; /* NaN if absent, zero or 0/0 */
    char datetime[40], subsec[16], offset[16]; /* DateTimeOriginal, its subseconds and its offset; "" if absent */
    char make[64], model[64];
    char projection[32]; /* GPano:ProjectionType of XMP; "" if absent */
    bool is_adobe_rgb;   /* ColorSpace is "uncalibrated" and the interoperability index R03 */
} cn_exif;

/* Whether a camera can be there. Cameras without a fix write 0, 0, which lies in the Atlantic. */
static inline bool cn_exif_is_place(double latitude_deg, double longitude_deg)
{
    const bool on_earth = latitude_deg >= -90 && latitude_deg <= 90 && longitude_deg >= -180 && longitude_deg <= 180;
    return on_earth && (latitude_deg != 0 || longitude_deg != 0);
}
#endif
