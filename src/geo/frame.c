#include "base/units.h"
#include "bridge/geographiclib.h"
#include "geo/heights.h"

#include <math.h>
#include <string.h>

void cn_frame_init(cn_frame *frame)
{
    memset(frame, 0, sizeof *frame);
    frame->scale = 1.0;
    frame->rotation[0] = frame->rotation[4] = frame->rotation[8] = 1.0;
}

const char *cn_frame_unit(const cn_frame *frame)
{
    return frame->georeferenced ? "m" : "units";
}

const char *cn_frame_heights(const cn_frame *frame)
{
    return frame->geoid_applied ? "above the WGS84 ellipsoid" : "above the sea, as the photos' GPS has it";
}

static cn_status check_georeferenced(const cn_frame *frame)
{
    if (frame->georeferenced) return CN_OK;
    return cn_fail(CN_ERR_DATA, "this city has no georeference (too few photos with GPS), so local positions have no "
                                "latitude and longitude; use local coordinates");
}

cn_status cn_frame_to_geodetic(const cn_frame *frame, const double local_m[3], double lat_lon_h[3])
{
    CN_TRY(check_georeferenced(frame));
    const double origin[3] = { frame->latitude_deg, frame->longitude_deg, frame->height_m };
    return cn_geographic_reverse(origin, local_m, lat_lon_h);
}

cn_status cn_frame_from_geodetic(const cn_frame *frame, const double lat_lon_h[3], double local_m[3])
{
    CN_TRY(check_georeferenced(frame));
    const double origin[3] = { frame->latitude_deg, frame->longitude_deg, frame->height_m };
    return cn_geographic_forward(origin, lat_lon_h, local_m);
}

void cn_frame_ecef(const cn_frame *f, double m[16])
{
    const double a = 6378137, flat = 1 / 298.257223563, e2 = flat * (2 - flat);
    const double lat = cn_radians(f->latitude_deg), lon = cn_radians(f->longitude_deg);
    const double s = sin(lat), c = cos(lat), sl = sin(lon), cl = cos(lon), n = a / sqrt(1 - e2 * s * s);
    const double columns[16] = { -sl,
                                 cl,
                                 0,
                                 0,
                                 -s * cl,
                                 -s * sl,
                                 c,
                                 0,
                                 c * cl,
                                 c * sl,
                                 s,
                                 0,
                                 (n + f->height_m) * c * cl,
                                 (n + f->height_m) * c * sl,
                                 (n * (1 - e2) + f->height_m) * s,
                                 1 };
    memcpy(m, columns, sizeof columns);
}

cn_status cn_geo_mgrs(double latitude_deg, double longitude_deg, int precision, char out[32])
{
    return cn_geographic_mgrs(latitude_deg, longitude_deg, precision, out);
}

cn_status cn_geo_utm_epsg(double latitude_deg, double longitude_deg, int *epsg)
{
    int zone;
    bool north;
    CN_TRY(cn_geographic_utm_zone(latitude_deg, longitude_deg, &zone, &north));
    /* 32661 and 32761, the polar ones, are what zone 61 would be. */
    *epsg = (north ? 32600 : 32700) + (zone == 0 ? 61 : zone);
    return CN_OK;
}
