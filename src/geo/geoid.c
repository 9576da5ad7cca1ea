#include "geo/geoid.h"

#include <math.h>
#include <proj.h>
#include <stdio.h>
#include <string.h>

static cn_status heights_with(PJ *pipeline, size_t n, const double *latitude_deg, const double *longitude_deg,
                              double *height_m)
{
    for (size_t i = 0; i < n; i++) {
        if (!isfinite(longitude_deg[i]) || !(fabs(latitude_deg[i]) <= 90.0))
            return cn_fail(CN_ERR_DATA, "latitude %g, longitude %g is not a place on Earth", latitude_deg[i],
                           longitude_deg[i]);
        /* The grid covers -180..180, but longitudes of a track across the antimeridian may go beyond. */
        double longitude = remainder(longitude_deg[i], 360.0);
        PJ_COORD out = proj_trans(pipeline, PJ_FWD, proj_coord(longitude, latitude_deg[i], 0.0, 0.0));
        if (!isfinite(out.xyz.z))
            return cn_fail(CN_ERR_DATA, "no geoid height at latitude %g, longitude %g", latitude_deg[i],
                           longitude_deg[i]);
        height_m[i] = out.xyz.z;
    }
    return CN_OK;
}

cn_status cn_geoid_heights(const char *grid, size_t n, const double *latitude_deg, const double *longitude_deg,
                           double *height_m, bool *found)
{
    char text[256];
    /* vgridshift subtracts unless told otherwise: multiplier 1 turns a height of 0 above sea level into the
     * undulation. */
    snprintf(text, sizeof text,
             "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
             "+step +proj=vgridshift +grids=%s +multiplier=1",
             grid);
    *found = false;
    memset(height_m, 0, n * sizeof *height_m);
    PJ_CONTEXT *context = proj_context_create();
    if (!context) return cn_fail(CN_ERR_NOMEM, "out of memory opening PROJ");
    proj_log_level(context, PJ_LOG_NONE);
    proj_context_set_enable_network(context, 0);
    PJ *pipeline = proj_create(context, text);
    cn_status status = CN_OK;
    if (pipeline) {
        *found = true;
        status = heights_with(pipeline, n, latitude_deg, longitude_deg, height_m);
        proj_destroy(pipeline);
    }
    proj_context_destroy(context);
    return status;
}

cn_status cn_geo_geoid_height(double latitude_deg, double longitude_deg, double *height_m, bool *found)
{
    return cn_geoid_heights(CN_GEOID_GRID, 1, &latitude_deg, &longitude_deg, height_m, found);
}
