/* Camera paths from JSON keyframes; the format is in jobs/README.md. */
#include "path/path.h"

#include "base/json.h"
#include "math/linalg.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_KEYFRAMES 1000000

/* Context for a keyframe: its name for messages, and the frame for coordinates. */
typedef struct reading {
    const cn_frame *frame;
    char where[512];
} reading;

static cn_status check_keys(const json_t *object, const char *where, const char *const *keys)
{
    const char *key;
    json_t *value;
    if (!json_is_object(object)) return cn_fail(CN_ERR_FORMAT, "%s: an object {...} belongs here", where);
    json_object_foreach((json_t *)object, key, value)
    {
        size_t i = 0;
        while (keys[i] && strcmp(keys[i], key) != 0)
            i++;
        if (!keys[i])
            return cn_fail(CN_ERR_FORMAT, "%s: unknown key \"%s\"; the keys are in jobs/README.md", where, key);
    }
    return CN_OK;
}

/* A place, as "local" metres or as "lat", "lon", "height_m". */
static cn_status read_place(const reading *in, const char *where, const json_t *object, double local_m[3])
{
    bool geographic =
        json_object_get(object, "lat") || json_object_get(object, "lon") || json_object_get(object, "height_m");
    if (json_object_get(object, "local")) {
        if (geographic)
            return cn_fail(CN_ERR_FORMAT, "%s: give \"local\" or \"lat\", \"lon\", \"height_m\", not both", where);
        return cn_json_numbers(object, where, "local", local_m, 3);
    }
    if (!geographic)
        return cn_fail(CN_ERR_FORMAT, "%s: no place; give \"lat\", \"lon\", \"height_m\" or \"local\": [x, y, z]",
                       where);
    double place[3];
    CN_TRY(cn_json_number(object, where, "lat", &place[0]));
    CN_TRY(cn_json_number(object, where, "lon", &place[1]));
    CN_TRY(cn_json_number(object, where, "height_m", &place[2]));
    if (!in->frame->georeferenced)
        return cn_fail(CN_ERR_FORMAT,
                       "%s: \"lat\" and \"lon\" need a georeferenced city, and this one has no GPS; "
                       "give \"local\": [x, y, z]",
                       where);
    if (!(fabs(place[0]) <= 90) || !(fabs(place[1]) <= 360))
        return cn_fail(CN_ERR_FORMAT, "%s: latitude %g, longitude %g is not on Earth", where, place[0], place[1]);
    return cn_frame_from_geodetic(in->frame, place, local_m);
}

static cn_status read_keyframe(const reading *in, const json_t *object, const cn_keyframe *before, cn_keyframe *key)
{
    static const char *const keys[] = { "time_s",      "lat",       "lon",      "height_m", "local", "look_at",
                                        "heading_deg", "pitch_deg", "roll_deg", "vfov_deg", NULL };
    static const char *const target_keys[] = { "lat", "lon", "height_m", "local", NULL };
    const char *where = in->where;
    double pitch = 0, m[9];
    *key = (cn_keyframe){ 0 };
    CN_TRY(check_keys(object, where, keys));
    if (before)
        CN_TRY(cn_json_number(object, where, "time_s", &key->time_s));
    else
        CN_TRY(cn_json_number_or(object, where, "time_s", 0, &key->time_s));
    if (before && !(key->time_s > before->time_s))
        return cn_fail(CN_ERR_FORMAT, "%s: \"time_s\" %g is not later than %g; times must increase", where, key->time_s,
                       before->time_s);
    CN_TRY(cn_json_number_or(object, where, "vfov_deg", before ? before->vfov_deg : 60, &key->vfov_deg));
    if (!(key->vfov_deg >= 1 && key->vfov_deg <= 170))
        return cn_fail(CN_ERR_FORMAT, "%s: \"vfov_deg\" %g must lie between 1 and 170", where, key->vfov_deg);
    CN_TRY(cn_json_number_or(object, where, "roll_deg", 0, &key->roll_deg));
    CN_TRY(cn_json_number_or(object, where, "heading_deg", before ? before->heading_deg : 0, &key->heading_deg));
    CN_TRY(cn_json_number_or(object, where, "pitch_deg", 0, &pitch));
    CN_TRY(read_place(in, where, object, key->position));
    const json_t *target = json_object_get(object, "look_at");
    if (target) {
        char there[sizeof in->where + 16];
        snprintf(there, sizeof there, "%s, look_at", where);
        if (json_object_get(object, "pitch_deg"))
            return cn_fail(CN_ERR_FORMAT, "%s: give \"look_at\" or \"pitch_deg\", not both", where);
        CN_TRY(check_keys(target, there, target_keys));
        CN_TRY(read_place(in, there, target, key->target));
        key->has_target = true;
        if (!cn_path_look(key->position, key->target, key->heading_deg, key->roll_deg, m))
            return cn_fail(CN_ERR_FORMAT, "%s: the camera is at the place that it looks at; move one of them", where);
    } else {
        if (!json_object_get(object, "heading_deg"))
            return cn_fail(CN_ERR_FORMAT, "%s: no direction; give \"look_at\" or \"heading_deg\" and \"pitch_deg\"",
                           where);
        cn_path_angles(key->heading_deg, pitch, key->roll_deg, m);
    }
    cn_mat3_to_quat(m, key->quat);
    return CN_OK;
}

static cn_status read_keyframes(const char *file, const json_t *list, const cn_frame *frame, cn_keyframe *keys)
{
    for (size_t i = 0; i < json_array_size(list); i++) {
        reading in = { .frame = frame };
        snprintf(in.where, sizeof in.where, "%s: keyframe %zu", file, i);
        CN_TRY(read_keyframe(&in, json_array_get(list, i), i ? &keys[i - 1] : NULL, &keys[i]));
    }
    return CN_OK;
}

static cn_status read_length(const char *file, const json_t *root, double duration_s, const cn_path_options *options,
                             cn_path *path)
{
    cn_path_options mine = *options;
    double fps;
    CN_TRY(cn_json_number_or(root, file, "fps", options->fps > 0 ? options->fps : 24, &fps));
    if (json_object_get(root, "frames") && !options->n_frames) {
        int64_t given;
        CN_TRY(cn_json_integer(root, file, "frames", &given));
        if (given < 1 || given > MAX_KEYFRAMES)
            return cn_fail(CN_ERR_FORMAT, "%s: \"frames\" must lie between 1 and %d", file, MAX_KEYFRAMES);
        mine.n_frames = (uint32_t)given;
    }
    return cn_path_start(path, file, duration_s, fps, &mine);
}

static cn_status read_camera(const char *file, const json_t *root, bool *around)
{
    const char *name = "pinhole";
    if (json_object_get(root, "camera")) CN_TRY(cn_json_string(root, file, "camera", &name));
    *around = strcmp(name, "equirectangular") == 0;
    if (*around || strcmp(name, "pinhole") == 0) return CN_OK;
    return cn_fail(CN_ERR_FORMAT, "%s: \"camera\" is \"%s\"; give \"pinhole\" or \"equirectangular\"", file, name);
}

cn_status cn_path_from_keyframes(cn_path *path, const char *file, const json_t *root, const cn_path_options *options)
{
    static const char *const keys[] = { "fps", "frames", "keyframes", "camera", NULL };
    const json_t *list;
    bool around = false;
    CN_TRY(check_keys(root, file, keys));
    CN_TRY(read_camera(file, root, &around));
    CN_TRY(cn_json_array(root, file, "keyframes", &list));
    size_t n = json_array_size(list);
    if (n == 0 || n > MAX_KEYFRAMES)
        return cn_fail(CN_ERR_FORMAT, "%s: \"keyframes\" holds %zu; it must hold 1 to %d", file, n, MAX_KEYFRAMES);
    cn_keyframe *items = calloc(n, sizeof *items);
    if (!items) return cn_fail(CN_ERR_NOMEM, "out of memory for the %zu keyframes of %s", n, file);
    cn_status status = read_keyframes(file, list, options->frame, items);
    if (status == CN_OK) status = read_length(file, root, items[n - 1].time_s - items[0].time_s, options, path);
    if (status == CN_OK) status = cn_path_fly(path, items, n, options->width, options->height);
    if (status == CN_OK && around) status = cn_path_look_around(path);
    free(items);
    return status;
}
