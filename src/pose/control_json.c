/* The ground_control_points.json of OpenSfM (opensfm/io.py): latitude, longitude and altitude of WGS84, and places in
 * photos from the centre, in units of the longer side. */
#include "base/file.h"
#include "base/json.h"
#include "pose/control_file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static cn_status read_place(const json_t *point, const char *where, double place[3])
{
    const json_t *position = json_object_get(point, "position");
    if (!json_is_object(position))
        return cn_fail(CN_ERR_FORMAT, "%s: \"position\" with latitude and longitude is missing", where);
    CN_TRY(cn_json_number(position, where, "longitude", &place[0]));
    CN_TRY(cn_json_number(position, where, "latitude", &place[1]));
    return cn_json_number_or(position, where, "altitude", NAN, &place[2]);
}

static cn_status read_marks(cn_control_file *file, const json_t *point, const char *where, uint32_t at)
{
    const json_t *list, *item;
    size_t i;
    CN_TRY(cn_json_array(point, where, "observations", &list));
    json_array_foreach(list, i, item)
    {
        double xy[2];
        cn_control_seen seen = { .point = at, .fractions = true };
        CN_TRY(cn_json_string(item, where, "shot_id", &seen.photo));
        if (!json_object_get(item, "projection")) continue; /* seen, but not marked */
        CN_TRY(cn_json_numbers(item, where, "projection", xy, 2));
        seen.x = xy[0];
        seen.y = xy[1];
        CN_TRY(cn_control_file_mark(file, &seen));
    }
    return CN_OK;
}

static cn_status read_point(cn_control_file *file, const json_t *point, size_t i)
{
    const char *id;
    double place[3];
    uint32_t at;
    char where[600];
    snprintf(where, sizeof where, "%.500s, point %zu", file->source->path, i + 1);
    CN_TRY(cn_json_string(point, where, "id", &id));
    CN_TRY(read_place(point, where, place));
    CN_TRY(cn_control_file_point(file, id, place, &at));
    const char *role = json_string_value(json_object_get(point, "role"));
    if (role && strcmp(role, "metrics_only") == 0) file->to->points[at].check = true;
    return read_marks(file, point, where, at);
}

cn_status cn_control_read_json(cn_control_file *file)
{
    json_t *root = NULL;
    const json_t *points = NULL, *point;
    size_t i;
    CN_TRY(cn_json_load(file->source->path, &root));
    cn_status status = cn_json_array(root, file->source->path, "points", &points);
    snprintf(file->crs, sizeof file->crs, "WGS84");
    if (status == CN_OK) {
        json_array_foreach((json_t *)points, i, point)
        {
            status = read_point(file, point, i);
            if (status != CN_OK) break;
        }
    }
    json_decref(root);
    return status;
}
