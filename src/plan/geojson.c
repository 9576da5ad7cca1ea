/* Writes tiles.geojson (RFC 7946): a circle and a centre for each tile, for QGIS and web maps. */
#include "plan/plan.h"

#include "base/units.h"

#include <math.h>

#define CORNERS 64

/* Longitude, latitude in degrees; local coordinates when there is no georeference. */
static cn_status place_of(const cn_frame *frame, const double local[3], double out[2])
{
    double place[3];
    out[0] = local[0];
    out[1] = local[1];
    if (!frame->georeferenced) return CN_OK;
    CN_TRY(cn_frame_to_geodetic(frame, local, place));
    out[0] = place[1];
    out[1] = place[0];
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

/* A tile's rim, counter-clockwise and not closed. Longitudes continue beyond 180 degrees, so that successive points
 * are near. */
typedef struct outline {
    double at[2 * CORNERS][2];
    int n;
} outline;

static void add_corner(outline *o, double x, double y)
{
    o->at[o->n][0] = x;
    o->at[o->n++][1] = y;
}

static cn_status trace(const cn_plan_tile *tile, const cn_frame *frame, outline *o)
{
    double turned = 0;
    *o = (outline){ .n = 0 };
    for (int i = 0; i <= CORNERS; i++) {
        const double angle = 2 * CN_PI * (i % CORNERS) / CORNERS;
        const double local[3] = { tile->centre[0] + tile->radius_m * cos(angle),
                                  tile->centre[1] + tile->radius_m * sin(angle), tile->centre[2] };
        double place[2];
        CN_TRY(place_of(frame, local, place));
        if (i && frame->georeferenced) {
            const double step = remainder(place[0] - o->at[i - 1][0], 360);
            turned += step;
            place[0] = o->at[i - 1][0] + step;
        }
        add_corner(o, place[0], place[1]);
    }
    o->n--; /* the last corner is the first */
    if (!frame->georeferenced || fabs(turned) < 180) return CN_OK;
    /* Around a pole the rim is a line across all longitudes. The pole itself closes the shape. */
    const double pole = turned > 0 ? 90 : -90, first = o->at[0][0], last = first + copysign(360, turned);
    add_corner(o, last, o->at[0][1]);
    add_corner(o, last, pole);
    add_corner(o, first, pole);
    return CN_OK;
}

/* The part of the outline on one side of a meridian: side 1 is east of it, -1 west. */
static void cut(const outline *in, double meridian, double side, outline *out)
{
    *out = (outline){ .n = 0 };
    for (int i = 0; i < in->n; i++) {
        const double *a = in->at[i], *b = in->at[(i + 1) % in->n];
        const double from = side * (a[0] - meridian), to = side * (b[0] - meridian);
        if (from >= 0) add_corner(out, a[0], a[1]);
        if ((from > 0 && to < 0) || (from < 0 && to > 0))
            add_corner(out, meridian, a[1] + (b[1] - a[1]) * from / (from - to));
    }
}

/* The ring of an outline moved by whole turns, closed on its first corner. NULL when nothing is inside. */
static json_t *ring_of(const outline *o, double turns)
{
    double west = INFINITY, east = -INFINITY;
    for (int i = 0; i < o->n; i++) {
        west = fmin(west, o->at[i][0]);
        east = fmax(east, o->at[i][0]);
    }
    if (!(east > west)) return NULL;
    json_t *ring = json_array();
    for (int i = 0; i <= o->n; i++) {
        const double *at = o->at[i % o->n];
        json_array_append_new(ring, cn_json_reals((double[]){ at[0] - 360 * turns, at[1] }, 2));
    }
    return ring;
}

/* Cuts shapes at 180 degrees (RFC 7946, 3.1.9). Returns polygons: lists of one ring each. */
static json_t *cut_at_antimeridian(const outline *o)
{
    json_t *polygons = json_array();
    for (int turns = -1; turns <= 1; turns++) {
        outline west, part;
        cut(o, 360 * turns - 180, 1, &west);
        cut(&west, 360 * turns + 180, -1, &part);
        json_t *ring = ring_of(&part, turns);
        if (ring) json_array_append_new(polygons, json_pack("[o]", ring));
    }
    return polygons;
}

static cn_status add_tile(json_t *features, const cn_plan_tile *tile, const cn_frame *frame)
{
    outline rim;
    double centre[2];
    CN_TRY(trace(tile, frame, &rim));
    CN_TRY(place_of(frame, tile->centre, centre));
    json_t *polygons = frame->georeferenced ? cut_at_antimeridian(&rim) : json_pack("[[o]]", ring_of(&rim, 0));
    if (json_array_size(polygons) == 1)
        add_feature(features, tile, "tile", "Polygon", json_incref(json_array_get(polygons, 0)));
    else
        add_feature(features, tile, "tile", "MultiPolygon", json_incref(polygons));
    json_decref(polygons);
    add_feature(features, tile, "centre", "Point", cn_json_reals(centre, 2));
    return CN_OK;
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
