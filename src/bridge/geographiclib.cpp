#include "bridge/geographiclib.h"

#include <GeographicLib/LocalCartesian.hpp>
#include <GeographicLib/MGRS.hpp>
#include <GeographicLib/UTMUPS.hpp>

#include <cmath>
#include <cstring>
#include <string>

namespace
{

// LocalCartesian gives NaN for a latitude of 95 and throws nothing. So every coordinate is checked before.
cn_status check(double latitude, double longitude, double height)
{
    if (std::isfinite(latitude) && std::isfinite(longitude) && std::isfinite(height) && std::fabs(latitude) <= 90.0 &&
        std::fabs(longitude) <= 540.0)
        return CN_OK;
    return cn_fail(CN_ERR_DATA,
                   "latitude %g, longitude %g, height %g is not a place on Earth; "
                   "latitudes lie within -90..90 degrees",
                   latitude, longitude, height);
}

template <typename Work> cn_status guarded(const char *what, Work work)
{
    try {
        work();
        return CN_OK;
    } catch (const std::bad_alloc &) {
        return cn_fail(CN_ERR_NOMEM, "%s: out of memory", what);
    } catch (const std::exception &error) {
        return cn_fail(CN_ERR_DATA, "%s: %s", what, error.what());
    } catch (...) {
        return cn_fail(CN_ERR_INTERNAL, "%s: unknown exception from GeographicLib", what);
    }
}

} // namespace

cn_status cn_geographic_forward(const double origin[3], const double lat_lon_h[3], double local_m[3])
{
    CN_TRY(check(origin[0], origin[1], origin[2]));
    CN_TRY(check(lat_lon_h[0], lat_lon_h[1], lat_lon_h[2]));
    return guarded("coordinates to local metres", [&] {
        const GeographicLib::LocalCartesian frame(origin[0], origin[1], origin[2]);
        frame.Forward(lat_lon_h[0], lat_lon_h[1], lat_lon_h[2], local_m[0], local_m[1], local_m[2]);
    });
}

cn_status cn_geographic_reverse(const double origin[3], const double local_m[3], double lat_lon_h[3])
{
    CN_TRY(check(origin[0], origin[1], origin[2]));
    if (!std::isfinite(local_m[0]) || !std::isfinite(local_m[1]) || !std::isfinite(local_m[2]))
        return cn_fail(CN_ERR_DATA, "local position (%g, %g, %g) is not finite", local_m[0], local_m[1], local_m[2]);
    return guarded("local metres to coordinates", [&] {
        const GeographicLib::LocalCartesian frame(origin[0], origin[1], origin[2]);
        frame.Reverse(local_m[0], local_m[1], local_m[2], lat_lon_h[0], lat_lon_h[1], lat_lon_h[2]);
    });
}

cn_status cn_geographic_mgrs(double latitude_deg, double longitude_deg, int precision, char out[32])
{
    CN_TRY(check(latitude_deg, longitude_deg, 0.0));
    if (precision < 0 || precision > 5)
        return cn_fail(CN_ERR_USAGE, "MGRS precision %d: choose 0 to 5 digits", precision);
    return guarded("MGRS", [&] {
        int zone;
        bool north;
        double x, y;
        std::string text;
        GeographicLib::UTMUPS::Forward(latitude_deg, longitude_deg, zone, north, x, y);
        GeographicLib::MGRS::Forward(zone, north, x, y, latitude_deg, precision, text);
        if (text.size() >= 32) throw std::length_error("text too long");
        std::memcpy(out, text.c_str(), text.size() + 1);
    });
}

cn_status cn_geographic_utm_zone(double latitude_deg, double longitude_deg, int *zone, bool *north)
{
    CN_TRY(check(latitude_deg, longitude_deg, 0.0));
    return guarded("UTM zone", [&] {
        *zone = GeographicLib::UTMUPS::StandardZone(latitude_deg, longitude_deg);
        *north = latitude_deg >= 0.0;
    });
}
