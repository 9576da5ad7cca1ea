/* Camera paths from JSON keyframes; the format is in jobs/README.md. */
#include "render/path.h"

#include "base/file.h"
#include "base/json.h"
#include "math/linalg.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_FRAMES 1000000
#define RADIANS (3.14159265358979323846 / 180)

typedef struct keyframe {
    double time_s, vfov_deg, roll_deg, heading_deg;
    double position[3], target[3]; /* local metres */
    bool has_target;
    double quat[4]; /* cam_from_world */
} keyframe;

/* What a keyframe is read against: where it is for messages, and the frame for coordinates. */
typedef struct reading { const cn_frame *frame; char where[512]; } reading;

cn_status cn_path_allocate(cn_path *path, uint32_t n_frames, double fps)
{
    *path = (cn_path){.frames = calloc(n_frames, sizeof *path->frames), .n_frames = n_frames, .fps = fps};
    if (path->frames) return CN_OK;
    path->n_frames = 0;
    return cn_fail(CN_ERR_NOMEM, "out of memory for a camera path of %u frames; ask for fewer", n_frames);
}

void cn_path_deinit(cn_path *path)
{
    for (uint32_t i = 0; i < path->n_frames; i++) free(path->frames[i].view.name);
    free(path->frames);
    *path = (cn_path){0};
}

cn_status cn_path_place(cn_path *path, uint32_t i, double time_s, double vfov_deg, uint32_t width, uint32_t height,
                        const double cam_from_world[9], const double centre[3])
{
    cn_path_frame *frame = &path->frames[i];
    double focal = height / 2.0 / tan(vfov_deg / 2 * RADIANS);
    frame->time_s = time_s;
    frame->camera = (cn_camera){.lens = CN_LENS_PINHOLE, .width = width, .height = height,
                                .params = {focal, focal, width / 2.0, height / 2.0}};
    frame->view.photo = UINT32_MAX;
    memcpy(frame->view.rotation, cam_from_world, sizeof frame->view.rotation);
    cn_mat3_vec(cam_from_world, centre, frame->view.translation);
    for (int k = 0; k < 3; k++) frame->view.translation[k] = -frame->view.translation[k];
    frame->view.name = cn_format("frame_%05u", i);
    return frame->view.name ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for a camera path");
}

/* ---- orientation ---- */

/* Rows right, down, forward: heading clockwise from north, pitch up, roll clockwise as seen from behind the camera. */
static void rotation_from_angles(double heading_deg, double pitch_deg, double roll_deg, double m[9])
{
    double h = heading_deg * RADIANS, p = pitch_deg * RADIANS, r = roll_deg * RADIANS;
    double forward[3] = {sin(h) * cos(p), cos(h) * cos(p), sin(p)}, right[3] = {cos(h), -sin(h), 0}, down[3];
    cn_cross3(forward, right, down);
    for (int k = 0; k < 3; k++) {
        m[k] = cos(r) * right[k] + sin(r) * down[k];
        m[3 + k] = cos(r) * down[k] - sin(r) * right[k];
        m[6 + k] = forward[k];
    }
}

/* heading_deg decides which way is up in the picture when the target is straight above or below. */
static bool rotation_to_target(const double position[3], const double target[3], double heading_deg, double roll_deg,
                               double m[9])
{
    double d[3] = {target[0] - position[0], target[1] - position[1], target[2] - position[2]};
    double across = hypot(d[0], d[1]), length = hypot(across, d[2]);
    if (!(length > 1e-9)) return false;
    double heading = across > 1e-6 * length ? atan2(d[0], d[1]) / RADIANS : heading_deg;
    rotation_from_angles(heading, atan2(d[2], across) / RADIANS, roll_deg, m);
    return true;
}

/* ---- reading ---- */

static cn_status check_keys(const json_t *object, const char *where, const char *const *keys)
{
    const char *key;
    json_t *value;
    if (!json_is_object(object)) return cn_fail(CN_ERR_FORMAT, "%s: an object {...} belongs here", where);
    json_object_foreach((json_t *)object, key, value)
    {
        size_t i = 0;
        while (keys[i] && strcmp(keys[i], key) != 0) i++;
        if (!keys[i]) return cn_fail(CN_ERR_FORMAT, "%s: unknown key \"%s\"; the keys are in jobs/README.md", where, key);
    }
    return CN_OK;
}

/* A place, as "local" metres or as "lat", "lon", "height_m". */
static cn_status read_place(const reading *in, const char *where, const json_t *object, double local_m[3])
{
    bool geographic = json_object_get(object, "lat") || json_object_get(object, "lon") || json_object_get(object, "height_m");
    if (json_object_get(object, "local")) {
        if (geographic) return cn_fail(CN_ERR_FORMAT, "%s: give \"local\" or \"lat\", \"lon\", \"height_m\", not both", where);
        return cn_json_numbers(object, where, "local", local_m, 3);
    }
    if (!geographic)
        return cn_fail(CN_ERR_FORMAT, "%s: no place; give \"lat\", \"lon\", \"height_m\" or \"local\": [x, y, z]", where);
    double place[3];
    CN_TRY(cn_json_number(object, where, "lat", &place[0]));
    CN_TRY(cn_json_number(object, where, "lon", &place[1]));
    CN_TRY(cn_json_number(object, where, "height_m", &place[2]));
    if (!in->frame->georeferenced)
        return cn_fail(CN_ERR_FORMAT, "%s: \"lat\" and \"lon\" need a georeferenced city, and this one has no GPS; "
                       "give \"local\": [x, y, z]", where);
    if (!(fabs(place[0]) <= 90) || !(fabs(place[1]) <= 360))
        return cn_fail(CN_ERR_FORMAT, "%s: latitude %g, longitude %g is not on Earth", where, place[0], place[1]);
    return cn_frame_from_geodetic(in->frame, place, local_m);
}

static cn_status read_keyframe(const reading *in, const json_t *object, const keyframe *before, keyframe *key)
{
    static const char *const keys[] = {"time_s", "lat", "lon", "height_m", "local", "look_at", "heading_deg", "pitch_deg",
                                       "roll_deg", "vfov_deg", NULL};
    static const char *const target_keys[] = {"lat", "lon", "height_m", "local", NULL};
    const char *where = in->where;
    double pitch = 0, m[9];
    *key = (keyframe){0};
    CN_TRY(check_keys(object, where, keys));
    if (before) CN_TRY(cn_json_number(object, where, "time_s", &key->time_s));
    else CN_TRY(cn_json_number_or(object, where, "time_s", 0, &key->time_s));
    if (before && !(key->time_s > before->time_s))
        return cn_fail(CN_ERR_FORMAT, "%s: \"time_s\" %g does not come after %g; times must rise", where, key->time_s,
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
        if (!rotation_to_target(key->position, key->target, key->heading_deg, key->roll_deg, m))
            return cn_fail(CN_ERR_FORMAT, "%s: the camera stands on the place that it looks at; move one of them", where);
    } else {
        if (!json_object_get(object, "heading_deg"))
            return cn_fail(CN_ERR_FORMAT, "%s: no direction; give \"look_at\" or \"heading_deg\" and \"pitch_deg\"", where);
        rotation_from_angles(key->heading_deg, pitch, key->roll_deg, m);
    }
    cn_mat3_to_quat(m, key->quat);
    return CN_OK;
}

static cn_status read_keyframes(const char *file, const json_t *list, const cn_frame *frame, keyframe *keys)
{
    for (size_t i = 0; i < json_array_size(list); i++) {
        reading in = {.frame = frame};
        snprintf(in.where, sizeof in.where, "%s: keyframe %zu", file, i);
        CN_TRY(read_keyframe(&in, json_array_get(list, i), i ? &keys[i - 1] : NULL, &keys[i]));
    }
    return CN_OK;
}

/* ---- interpolation ---- */

typedef double point3[3];

static void lerp3(const double a[3], const double b[3], double t, double out[3])
{
    for (int k = 0; k < 3; k++) out[k] = a[k] + t * (b[k] - a[k]);
}

/* Centripetal Catmull-Rom between p[1] and p[2] (Barry and Goldman's pyramid): no loops or cusps within a segment. */
static void catmull_rom(const point3 p[4], double t, double out[3])
{
    double knot[4] = {0}, step[3];
    for (int i = 0; i < 3; i++) step[i] = sqrt(cn_distance3(p[i], p[i + 1]));
    if (!(step[1] > 0)) {
        memcpy(out, p[1], sizeof(point3));
        return;
    }
    /* Neighbours that coincide give no direction of their own; any positive knot distance serves. */
    if (step[0] < 1e-6 * step[1]) step[0] = step[1];
    if (step[2] < 1e-6 * step[1]) step[2] = step[1];
    for (int i = 0; i < 3; i++) knot[i + 1] = knot[i] + step[i];
    double u = knot[1] + t * step[1];
    point3 a[3], b[2];
    for (int i = 0; i < 3; i++) lerp3(p[i], p[i + 1], (u - knot[i]) / (knot[i + 1] - knot[i]), a[i]);
    for (int i = 0; i < 2; i++) lerp3(a[i], a[i + 1], (u - knot[i]) / (knot[i + 2] - knot[i]), b[i]);
    lerp3(b[0], b[1], t, out);
}

/* The spline's four points for segment i; beyond the ends the neighbour is mirrored. target: of look-at points. */
static void segment_points(const keyframe *keys, size_t n, size_t i, bool target, point3 p[4])
{
    for (int j = 1; j <= 2; j++) {
        const keyframe *k = &keys[i + (size_t)j - 1];
        memcpy(p[j], target ? k->target : k->position, sizeof(point3));
    }
    if (i > 0) memcpy(p[0], target ? keys[i - 1].target : keys[i - 1].position, sizeof(point3));
    else lerp3(p[1], p[2], -1, p[0]);
    if (i + 2 < n) memcpy(p[3], target ? keys[i + 2].target : keys[i + 2].position, sizeof(point3));
    else lerp3(p[2], p[1], -1, p[3]);
}

static cn_status place_between(cn_path *path, uint32_t frame, double time_s, const keyframe *keys, size_t n, size_t i,
                               bool splined_targets, uint32_t width, uint32_t height)
{
    const keyframe *a = &keys[i], *b = i + 1 < n ? &keys[i + 1] : a;
    double t = b == a ? 0 : (time_s - a->time_s) / (b->time_s - a->time_s);
    t = fmin(fmax(t, 0), 1);
    double smooth = t * t * (3 - 2 * t), position[3], target[3], quat[4], m[9];
    double vfov = a->vfov_deg + smooth * (b->vfov_deg - a->vfov_deg);
    point3 p[4];
    memcpy(position, a->position, sizeof position);
    memcpy(target, a->target, sizeof target);
    if (b != a) {
        segment_points(keys, n, i, false, p);
        catmull_rom((const point3 *)p, t, position);
    }
    if (b != a && splined_targets) {
        segment_points(keys, n, i, true, p);
        catmull_rom((const point3 *)p, t, target);
    }
    double roll = a->roll_deg + smooth * (b->roll_deg - a->roll_deg);
    double heading = a->heading_deg + smooth * remainder(b->heading_deg - a->heading_deg, 360);
    /* A camera that flies through its target has no direction there: it keeps the one between the keyframes. */
    if (!splined_targets || !rotation_to_target(position, target, heading, roll, m)) {
        cn_quat_slerp(a->quat, b->quat, t, quat);
        cn_quat_to_mat3(quat, m);
    }
    return cn_path_place(path, frame, time_s, vfov, width, height, m, position);
}

static cn_status interpolate(cn_path *path, const keyframe *keys, size_t n, uint32_t width, uint32_t height)
{
    bool splined_targets = true;
    for (size_t i = 0; i < n; i++) splined_targets = splined_targets && keys[i].has_target;
    double first = keys[0].time_s, last = keys[n - 1].time_s;
    size_t segment = 0;
    for (uint32_t f = 0; f < path->n_frames; f++) {
        double time_s = path->n_frames > 1 ? first + (last - first) * f / (path->n_frames - 1) : first;
        while (segment + 2 < n && time_s >= keys[segment + 1].time_s) segment++;
        CN_TRY(place_between(path, f, time_s, keys, n, segment, splined_targets, width, height));
    }
    return CN_OK;
}

/* ---- loading ---- */

static cn_status read_length(const char *file, const json_t *root, const keyframe *keys, size_t n, double *fps,
                             uint32_t *n_frames)
{
    double frames = 1;
    CN_TRY(cn_json_number_or(root, file, "fps", 24, fps));
    if (!(*fps > 0 && *fps <= 1000)) return cn_fail(CN_ERR_FORMAT, "%s: \"fps\" %g must lie between 0 and 1000", file, *fps);
    if (n > 1) frames = floor((keys[n - 1].time_s - keys[0].time_s) * *fps + 0.5) + 1;
    if (json_object_get(root, "frames")) {
        int64_t given;
        CN_TRY(cn_json_integer(root, file, "frames", &given));
        if (given < 1) return cn_fail(CN_ERR_FORMAT, "%s: \"frames\" must be 1 or more", file);
        frames = (double)given;
    }
    if (!(frames <= MAX_FRAMES))
        return cn_fail(CN_ERR_FORMAT, "%s: %.0f frames are more than %d; lower \"fps\", \"frames\" or the times", file, frames,
                       MAX_FRAMES);
    *n_frames = (uint32_t)frames;
    return CN_OK;
}

static cn_status load_root(cn_path *path, const char *file, const json_t *root, const cn_frame *frame, uint32_t width,
                           uint32_t height)
{
    static const char *const keys[] = {"fps", "frames", "keyframes", NULL};
    const json_t *list;
    double fps;
    uint32_t n_frames = 0;
    CN_TRY(check_keys(root, file, keys));
    CN_TRY(cn_json_array(root, file, "keyframes", &list));
    size_t n = json_array_size(list);
    if (n == 0 || n > MAX_FRAMES)
        return cn_fail(CN_ERR_FORMAT, "%s: \"keyframes\" holds %zu; it must hold 1 to %d", file, n, MAX_FRAMES);
    keyframe *items = calloc(n, sizeof *items);
    if (!items) return cn_fail(CN_ERR_NOMEM, "out of memory for the %zu keyframes of %s", n, file);
    cn_status status = read_keyframes(file, list, frame, items);
    if (status == CN_OK) status = read_length(file, root, items, n, &fps, &n_frames);
    if (status == CN_OK) status = cn_path_allocate(path, n_frames, fps);
    if (status == CN_OK) status = interpolate(path, items, n, width, height);
    free(items);
    return status;
}

cn_status cn_path_load(cn_path *path, const char *file, const cn_frame *frame, uint32_t width, uint32_t height)
{
    json_t *root;
    *path = (cn_path){0};
    if (width == 0 || height == 0) return cn_fail(CN_ERR_USAGE, "a camera path needs a picture size above 0 x 0");
    CN_TRY(cn_json_load(file, &root));
    cn_status status = load_root(path, file, root, frame, width, height);
    json_decref(root);
    if (status != CN_OK) cn_path_deinit(path);
    return status;
}
