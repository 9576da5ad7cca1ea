#include "bridge/geographiclib.h"
#include "conurb/geo.h"

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
