/* tiles.geojson (RFC 7946): a circle and a centre a tile, for QGIS and web maps. */
#include "plan/plan.h"

#include "base/units.h"

#include <math.h>

#define CORNERS 64

/* Longitude, latitude in degrees; local metres when there is no georeference. */
static cn_status add_position(json_t *list, const cn_frame *frame, double x, double y, double z)
{
    double local[3] = { x, y, z }, place[3], lon_lat[2] = { x, y };
    if (frame->georeferenced) {
        CN_TRY(cn_frame_to_geodetic(frame, local, place));
        lon_lat[0] = place[1];
        lon_lat[1] = place[0];
    }
    json_array_append_new(list, cn_json_reals(lon_lat, 2));
    return CN_OK;
}

static json_t *properties(const cn_plan_tile *tile, const char *kind)
{
    json_t *p = json_object(), *on = json_array();
    for (uint32_t i = 0; i < tile->n_effects; i++)
        if (tile->effects[i].on) json_array_append_new(on, json_string(tile->effects[i].name));
    json_object_set_new(p, "kind", json_string(kind));
    json_object_set_new(p, "id", json_string(tile->id));
    json_object_set_new(p, "radius_m", cn_json_real(tile->radius_m));
    json_object_set_new(p, "photos", json_integer(tile->n_photos));
    json_object_set_new(p, "held_out", json_integer(tile->n_held_out));
    json_object_set_new(p, "near_m", cn_json_real(tile->near_m));
    json_object_set_new(p, "far_m", cn_json_real(tile->far_m));
    json_object_set_new(p, "estimate_s", cn_json_real(tile->estimate_s));
    json_object_set_new(p, "effects", on);
    return p;
}

static void add_feature(json_t *features, const cn_plan_tile *tile, const char *kind, const char *type,
                        json_t *coordinates)
{
    json_t *feature = json_object(), *geometry = json_object();
    json_object_set_new(geometry, "type", json_string(type));
    json_object_set_new(geometry, "coordinates", coordinates);
    json_object_set_new(feature, "type", json_string("Feature"));
    json_object_set_new(feature, "geometry", geometry);
    json_object_set_new(feature, "properties", properties(tile, kind));
    json_array_append_new(features, feature);
}

static cn_status add_tile(json_t *features, const cn_plan_tile *tile, const cn_frame *frame)
{
    json_t *ring = json_array(), *centre = json_array();
    cn_status status = add_position(centre, frame, tile->centre[0], tile->centre[1], tile->centre[2]);
    for (int i = 0; i <= CORNERS && status == CN_OK; i++) { /* counter-clockwise, closed on its first corner */
        double angle = 2 * CN_PI * (i % CORNERS) / CORNERS;
        status = add_position(ring, frame, tile->centre[0] + tile->radius_m * cos(angle),
                              tile->centre[1] + tile->radius_m * sin(angle), tile->centre[2]);
    }
    if (status == CN_OK) {
        json_t *rings = json_array();
        json_array_append(rings, ring);
        add_feature(features, tile, "tile", "Polygon", rings);
        add_feature(features, tile, "centre", "Point", json_incref(json_array_get(centre, 0)));
    }
    json_decref(ring);
    json_decref(centre);
    return status;
}

cn_status cn_plan_write_geojson(const cn_plan *plan, const cn_plan_input *input, const char *path)
{
    json_t *root = json_object(), *features = json_array();
    cn_status status = CN_OK;
    for (uint32_t i = 0; i < plan->n_tiles && status == CN_OK; i++)
        status = add_tile(features, &plan->tiles[i], input->frame);
    json_object_set_new(root, "type", json_string("FeatureCollection"));
    json_object_set_new(root, "features", features);
    if (!input->frame->georeferenced)
        json_object_set_new(root, "conurb:crs",
                            json_string("local: x and y in the units of the poses, without georeference"));
    if (status == CN_OK) status = cn_json_save(root, path);
    json_decref(root);
    return status;
}
