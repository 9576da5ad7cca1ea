/* Reads tile centres from GeoJSON (RFC 7946): a FeatureCollection of Points. */
#include "plan/plan.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_CENTRES 100000u

static cn_status read_point(const json_t *feature, const char *where, const cn_frame *frame, double place[2])
{
    const json_t *geometry = json_object_get(feature, "geometry"), *coordinates;
    const char *type;
    CN_TRY(cn_json_string(geometry, where, "type", &type));
    if (strcmp(type, "Point") != 0)
        return cn_fail(CN_ERR_FORMAT, "%s: a tile centre must be a Point, but is a %.40s", where, type);
    CN_TRY(cn_json_array(geometry, where, "coordinates", &coordinates));
    size_t n = json_array_size(coordinates);
    double xyz[3] = { 0, 0, frame->height_m }, local[3];
    if (n < 2 || n > 3) return cn_fail(CN_ERR_FORMAT, "%s: a Point holds 2 or 3 coordinates, not %zu", where, n);
    CN_TRY(cn_json_numbers(geometry, where, "coordinates", xyz, n));
    if (!frame->georeferenced) {
        memcpy(place, xyz, sizeof(double[2]));
        return CN_OK;
    }
    double lat_lon_h[3] = { xyz[1], xyz[0], xyz[2] }; /* GeoJSON has longitude first */
    if (!(lat_lon_h[0] >= -90 && lat_lon_h[0] <= 90 && lat_lon_h[1] >= -180 && lat_lon_h[1] <= 180))
        return cn_fail(CN_ERR_FORMAT, "%s: longitude %g, latitude %g is not on Earth; GeoJSON has longitude first",
                       where, xyz[0], xyz[1]);
    CN_TRY(cn_frame_from_geodetic(frame, lat_lon_h, local));
    memcpy(place, local, sizeof(double[2]));
    return CN_OK;
}

static cn_status read_features(const json_t *root, const char *path, const cn_frame *frame, double (**places)[2],
                               uint32_t *n)
{
    const char *type;
    const json_t *features;
    CN_TRY(cn_json_string(root, path, "type", &type));
    if (strcmp(type, "FeatureCollection") != 0)
        return cn_fail(CN_ERR_FORMAT, "%s: a FeatureCollection of Points belongs here, but this is a %.40s", path,
                       type);
    CN_TRY(cn_json_array(root, path, "features", &features));
    size_t count = json_array_size(features);
    if (count == 0 || count > MAX_CENTRES)
        return cn_fail(CN_ERR_FORMAT, "%s: holds %zu centres; 1 to %u belong here", path, count, MAX_CENTRES);
    *places = malloc(sizeof **places * count);
    if (!*places) return cn_fail(CN_ERR_NOMEM, "out of memory for the %zu centres of %s", count, path);
    for (size_t i = 0; i < count; i++) {
        char where[512];
        snprintf(where, sizeof where, "%s: feature %zu", path, i);
        CN_TRY(read_point(json_array_get(features, i), where, frame, (*places)[i]));
    }
    *n = (uint32_t)count;
    return CN_OK;
}

cn_status cn_plan_read_centres(const char *path, const cn_frame *frame, double (**places)[2], uint32_t *n)
{
    json_t *root;
    *places = NULL;
    *n = 0;
    CN_TRY(cn_json_load(path, &root));
    cn_status status = read_features(root, path, frame, places, n);
    json_decref(root);
    if (status != CN_OK) {
        free(*places);
        *places = NULL;
    }
    return status;
}
