/* cameras.txt, images.txt, points3D.txt. */
#include "base/file.h"
#include "base/number.h"
#include "pose/lens.h"
#include "pose/scene.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* A file read line by line; `at` walks within the current line, which is NUL-terminated in place. */
typedef struct text {
    const char *path;
    char *next, *at;
    size_t line;
    long long said;
} text;

static cn_status bad(const text *t, const char *what)
{
    return cn_fail(CN_ERR_FORMAT, "%s: line %zu: %s; the file is damaged, make it again", t->path, t->line, what);
}

static cn_status no_memory(const text *t)
{
    return cn_fail(CN_ERR_NOMEM, "%s: out of memory", t->path);
}

static bool next_line(text *t)
{
    if (!t->next || !*t->next) return false;
    t->at = t->next;
    char *end = strchr(t->at, '\n');
    t->next = end ? end + 1 : NULL;
    if (end) {
        *end = '\0';
        if (end > t->at && end[-1] == '\r') end[-1] = '\0';
    }
    t->line++;
    return true;
}

/* The next line with data. COLMAP's comment gives the number of items, which shows when a file is truncated. */
static bool next_record(text *t)
{
    while (next_line(t)) {
        t->at += strspn(t->at, " \t");
        if (*t->at == '#') {
            const char *said = strstr(t->at, "Number of ");
            const char *colon = said ? strchr(said, ':') : NULL;
            if (colon) t->said = atoll(colon + 1);
        } else if (*t->at) {
            return true;
        }
    }
    return false;
}

static bool at_end(text *t)
{
    t->at += strspn(t->at, " \t");
    return *t->at == '\0';
}

static bool number(text *t, double *value)
{
    char *end;
    *value = cn_parse_double(t->at, &end);
    bool read = end != t->at;
    t->at = end;
    return read;
}

static bool whole(text *t, uint64_t limit, uint64_t *value)
{
    char *end;
    t->at += strspn(t->at, " \t");
    if (*t->at < '0' || *t->at > '9') return false;
    *value = strtoull(t->at, &end, 10);
    t->at = end;
    return *value <= limit;
}

static bool id32(text *t, uint32_t *value)
{
    uint64_t wide;
    if (!whole(t, UINT32_MAX - 1, &wide)) return false;
    *value = (uint32_t)wide;
    return true;
}

static bool numbers(text *t, double *values, int n)
{
    for (int i = 0; i < n; i++)
        if (!number(t, &values[i])) return false;
    return true;
}

/* Makes room for one more item of `size` bytes; grows by a half. */
static bool grow(void *list, uint64_t n, uint64_t *capacity, size_t size)
{
    if (n < *capacity) return true;
    uint64_t wanted = *capacity + *capacity / 2 + 64;
    void **items = list, *grown = realloc(*items, wanted * size);
    if (!grown) return false;
    *items = grown;
    *capacity = wanted;
    return true;
}

static cn_status read_camera(text *t, cn_raw_model *raw, cn_camera *camera)
{
    char name[64];
    int length = 0;
    memset(camera, 0, sizeof *camera);
    if (!id32(t, &camera->id) || sscanf(t->at, " %63s%n", name, &length) != 1) return bad(t, "not a camera");
    t->at += length;
    const int lens = cn_lens_from_name(name), foreign = cn_lens_foreign_from_name(name);
    if (lens < 0 && foreign < 0)
        return cn_fail(CN_ERR_FORMAT,
                       "%s: line %zu: camera %u has lens model %s, which is not supported; supported "
                       "are " CN_LENS_NAMES ", " CN_LENS_FOREIGN_NAMES
                       " (undistort the photos with colmap image_undistorter, or "
                       "pose them again with one of these)",
                       t->path, t->line, camera->id, name);
    if (!id32(t, &camera->width) || !id32(t, &camera->height)) return bad(t, "the camera has no size");
    double params[CN_LENS_FOREIGN_PARAMS];
    if (!numbers(t, params, lens < 0 ? cn_lens_foreign_params(foreign) : cn_lens_params((cn_lens)lens)) || !at_end(t))
        return bad(t, "the camera has the wrong number of parameters");
    return cn_raw_set_lens(raw, camera, lens < 0 ? foreign : lens, params, t->path);
}

static cn_status read_cameras(text *t, cn_raw_model *raw)
{
    uint64_t capacity = 0;
    while (next_record(t)) {
        if (!grow(&raw->cameras, raw->n_cameras, &capacity, sizeof *raw->cameras)) return no_memory(t);
        CN_TRY(read_camera(t, raw, &raw->cameras[raw->n_cameras]));
        raw->n_cameras++;
    }
    return t->said >= 0 && t->said != raw->n_cameras ? bad(t, "fewer or more cameras than its head says") : CN_OK;
}

static cn_status read_keypoints(text *t, cn_raw_model *raw, cn_raw_view *view, uint64_t *capacity)
{
    view->first_keypoint = raw->n_keypoints;
    if (!next_line(t)) return CN_OK; /* a last photo without keypoints */
    while (!at_end(t)) {
        double values[3]; /* the point's id is repeated by the tracks */
        if (!numbers(t, values, 3)) return bad(t, "a keypoint is not three numbers");
        if (!grow(&raw->keypoints, raw->n_keypoints, capacity, sizeof *raw->keypoints)) return no_memory(t);
        raw->keypoints[raw->n_keypoints][0] = (float)values[0];
        raw->keypoints[raw->n_keypoints++][1] = (float)values[1];
        view->n_keypoints++;
    }
    return CN_OK;
}

static cn_status read_images(text *t, cn_raw_model *raw)
{
    uint64_t views = 0, keypoints = 0;
    while (next_record(t)) {
        if (!grow(&raw->views, raw->n_views, &views, sizeof *raw->views)) return no_memory(t);
        cn_raw_view *view = &raw->views[raw->n_views];
        memset(view, 0, sizeof *view);
        if (!id32(t, &view->id) || !numbers(t, view->quaternion, 4) || !numbers(t, view->translation, 3) ||
            !id32(t, &view->camera_id) || at_end(t))
            return bad(t, "not a photo's id, rotation, translation, camera and name");
        if (!(view->name = strdup(t->at))) return no_memory(t);
        raw->n_views++;
        CN_TRY(read_keypoints(t, raw, view, &keypoints));
    }
    return t->said >= 0 && t->said != raw->n_views ? bad(t, "fewer or more photos than its head says") : CN_OK;
}

static cn_status read_point(text *t, cn_raw_model *raw, uint64_t *capacity)
{
    cn_point *point = &raw->points[raw->n_points];
    uint64_t id, colour;
    double error;
    memset(point, 0, sizeof *point);
    if (!whole(t, UINT64_MAX, &id) || !numbers(t, point->xyz, 3)) return bad(t, "not a point");
    for (int k = 0; k < 3; k++) {
        if (!whole(t, 255, &colour)) return bad(t, "the point's colour is not 0 to 255");
        point->rgb[k] = (uint8_t)colour;
    }
    if (!number(t, &error)) return bad(t, "the point has no error");
    point->error_px = (float)error;
    point->first_observation = (uint32_t)raw->n_tracks;
    while (!at_end(t)) {
        cn_raw_track track;
        if (raw->n_tracks >= UINT32_MAX) return bad(t, "more than 2^32 observations");
        if (!id32(t, &track.view_id) || !id32(t, &track.keypoint)) return bad(t, "the point's track is not pairs");
        if (!grow(&raw->tracks, raw->n_tracks, capacity, sizeof *raw->tracks)) return no_memory(t);
        raw->tracks[raw->n_tracks++] = track;
        point->n_observations++;
    }
    return CN_OK;
}

static cn_status read_points(text *t, cn_raw_model *raw)
{
    uint64_t points = 0, tracks = 0;
    while (next_record(t)) {
        if (!grow(&raw->points, raw->n_points, &points, sizeof *raw->points)) return no_memory(t);
        CN_TRY(read_point(t, raw, &tracks));
        raw->n_points++;
    }
    return t->said >= 0 && t->said != raw->n_points ? bad(t, "fewer or more points than its head says") : CN_OK;
}

static cn_status read_file(cn_raw_model *raw, const char *dir, const char *name,
                           cn_status (*read)(text *, cn_raw_model *))
{
    char *path = cn_path_join(dir, name), *data = NULL;
    size_t size = 0;
    if (!path) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", dir);
    cn_status status = cn_file_read(path, SIZE_MAX / 4, &data, &size);
    if (status == CN_OK) {
        text t = { .path = path, .next = data, .said = -1 };
        status = strlen(data) == size ? read(&t, raw) : cn_fail(CN_ERR_FORMAT, "%s: is not a text file", path);
    }
    free(data);
    free(path);
    return status;
}

cn_status cn_raw_read_text(cn_raw_model *raw, const char *dir)
{
    CN_TRY(read_file(raw, dir, "cameras.txt", read_cameras));
    CN_TRY(read_file(raw, dir, "images.txt", read_images));
    return read_file(raw, dir, "points3D.txt", read_points);
}
