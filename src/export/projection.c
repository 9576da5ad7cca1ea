#include "export/projection.h"

#include "base/number.h"

#include <cpl_conv.h>
#include <cpl_error.h>
#include <ogr_srs_api.h>
#include <stdio.h>
#include <string.h>

static cn_status open_transforms(cn_projection *p)
{
    CN_TRY(cn_geo_utm_epsg(p->frame->latitude_deg, p->frame->longitude_deg, &p->epsg));
    CPLPushErrorHandler(CPLQuietErrorHandler); /* errors are returned, not printed */
    OGRSpatialReferenceH utm = OSRNewSpatialReference(NULL), wgs84 = OSRNewSpatialReference(NULL);
    const bool known = OSRImportFromEPSG(utm, p->epsg) == OGRERR_NONE && OSRImportFromEPSG(wgs84, 4326) == OGRERR_NONE;
    OSRSetAxisMappingStrategy(utm, OAMS_TRADITIONAL_GIS_ORDER);
    OSRSetAxisMappingStrategy(wgs84, OAMS_TRADITIONAL_GIS_ORDER);
    if (known) {
        p->to_geodetic = OCTNewCoordinateTransformation(utm, wgs84);
        p->from_geodetic = OCTNewCoordinateTransformation(wgs84, utm);
    }
    OSRDestroySpatialReference(utm);
    OSRDestroySpatialReference(wgs84);
    CPLPopErrorHandler();
    if (p->to_geodetic && p->from_geodetic) return CN_OK;
    return cn_fail(CN_ERR_TOOL, "PROJ's database has no EPSG:%d; install proj-data", p->epsg);
}

cn_status cn_projection_init(cn_projection *p, const cn_frame *frame)
{
    *p = (cn_projection){ .frame = frame };
    return frame->georeferenced ? open_transforms(p) : CN_OK;
}

void cn_projection_deinit(cn_projection *p)
{
    OCTDestroyCoordinateTransformation(p->to_geodetic);
    OCTDestroyCoordinateTransformation(p->from_geodetic);
    *p = (cn_projection){ 0 };
}

cn_status cn_projection_forward(const cn_projection *p, const double local_m[3], double xyh[3])
{
    double place[3];
    memmove(xyh, local_m, sizeof(double[3]));
    if (!p->epsg) return CN_OK;
    CN_TRY(cn_frame_to_geodetic(p->frame, local_m, place));
    xyh[0] = place[1];
    xyh[1] = place[0];
    xyh[2] = place[2];
    if (OCTTransform(p->from_geodetic, 1, &xyh[0], &xyh[1], NULL)) return CN_OK;
    return cn_fail(CN_ERR_DATA, "latitude %.6f, longitude %.6f cannot be converted to EPSG:%d", place[0], place[1],
                   p->epsg);
}

cn_status cn_projection_inverse(const cn_projection *p, const double xyh[3], double local_m[3])
{
    double x = xyh[0], y = xyh[1];
    if (!p->epsg) {
        memmove(local_m, xyh, sizeof(double[3]));
        return CN_OK;
    }
    if (!OCTTransform(p->to_geodetic, 1, &x, &y, NULL))
        return cn_fail(CN_ERR_DATA, "easting %.3f, northing %.3f lies outside EPSG:%d", xyh[0], xyh[1], p->epsg);
    return cn_frame_from_geodetic(p->frame, (const double[3]){ y, x, xyh[2] }, local_m);
}

cn_status cn_epsg_wkt(int epsg, char **wkt)
{
    char *text = NULL;
    OGRSpatialReferenceH crs = OSRNewSpatialReference(NULL);
    *wkt = NULL;
    const bool fine = OSRImportFromEPSG(crs, epsg) == OGRERR_NONE && OSRExportToWkt(crs, &text) == OGRERR_NONE;
    if (fine && text) *wkt = strdup(text);
    CPLFree(text);
    OSRDestroySpatialReference(crs);
    return *wkt ? CN_OK : cn_fail(CN_ERR_TOOL, "PROJ's database has no EPSG:%d; install proj-data", epsg);
}

void cn_projection_heights(const cn_frame *f, char text[160])
{
    if (!f->georeferenced)
        snprintf(text, 160, "local units of the poses; no georeference");
    else if (f->geoid_applied && f->geoid_height_m == 0)
        snprintf(text, 160, "metres above the WGS84 ellipsoid; the EGM96 undulation is not known here");
    else if (f->geoid_applied)
        cn_print(text, 160,
                 "metres above the WGS84 ellipsoid; subtract the EGM96 undulation (%.3f m at the origin) for "
                 "heights above the sea",
                 f->geoid_height_m);
    else
        snprintf(text, 160, "metres as the photos' GPS has them, above the sea; no geoid was applied");
}
