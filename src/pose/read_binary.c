/* Reads cameras.bin, images.bin, points3D.bin. Little-endian, like every supported machine. */
#include "base/file.h"
#include "pose/lens.h"
#include "pose/scene.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct cursor {
    const char *path;
    const unsigned char *data;
    size_t size, at;
} cursor;

static cn_status take(cursor *c, void *out, size_t n, const char *what)
{
    if (n > c->size - c->at)
        return cn_fail(CN_ERR_FORMAT, "%s: ends at byte %zu within %s; the file is truncated, copy or make it again",
                       c->path, c->size, what);
    memcpy(out, c->data + c->at, n);
    c->at += n;
    return CN_OK;
}

/* Reads a count of items of at least `each` bytes, and checks that enough bytes are left. */
static cn_status take_count(cursor *c, size_t each, const char *what, uint64_t *count)
{
    size_t at = c->at;
    CN_TRY(take(c, count, sizeof *count, what));
    if (*count > (c->size - c->at) / each || *count >= UINT32_MAX)
        return cn_fail(CN_ERR_FORMAT, "%s: byte %zu says %llu %s, more than the file can hold; it is damaged", c->path,
                       at, (unsigned long long)*count, what);
    return CN_OK;
}

static cn_status no_memory(const cursor *c)
{
    return cn_fail(CN_ERR_NOMEM, "%s: out of memory", c->path);
}

static cn_status read_camera(cursor *c, cn_raw_model *raw, cn_camera *camera)
{
    int32_t model = -1;
    uint64_t size[2] = { 0 };
    size_t at = c->at;
    CN_TRY(take(c, &camera->id, 4, "a camera"));
    CN_TRY(take(c, &model, 4, "a camera"));
    CN_TRY(take(c, size, 16, "a camera"));
    if (!cn_lens_is_known(model) && !cn_lens_foreign_params(model))
        return cn_fail(CN_ERR_FORMAT,
                       "%s: byte %zu: camera %u has COLMAP lens model %d, which is not supported; "
                       "supported are " CN_LENS_NAMES ", " CN_LENS_FOREIGN_NAMES " (undistort the photos with colmap "
                       "image_undistorter, or pose them again with one of these)",
                       c->path, at, camera->id, model);
    if (size[0] > UINT32_MAX || size[1] > UINT32_MAX)
        return cn_fail(CN_ERR_FORMAT, "%s: byte %zu: camera %u has an impossible size", c->path, at, camera->id);
    camera->width = (uint32_t)size[0];
    camera->height = (uint32_t)size[1];
    double params[CN_LENS_FOREIGN_PARAMS];
    const int n = cn_lens_is_known(model) ? cn_lens_params((cn_lens)model) : cn_lens_foreign_params(model);
    CN_TRY(take(c, params, (size_t)n * sizeof *params, "a camera's parameters"));
    return cn_raw_set_lens(raw, camera, model, params, c->path);
}

static cn_status read_cameras(cursor *c, cn_raw_model *raw)
{
    uint64_t n = 0;
    CN_TRY(take_count(c, 24 + 2 * 8, "cameras", &n));
    if (!(raw->cameras = calloc(n + 1, sizeof *raw->cameras))) return no_memory(c);
    for (; raw->n_cameras < n; raw->n_cameras++)
        CN_TRY(read_camera(c, raw, &raw->cameras[raw->n_cameras]));
    return CN_OK;
}

static cn_status read_name(cursor *c, char **name)
{
    const unsigned char *end = memchr(c->data + c->at, 0, c->size - c->at);
    if (!end)
        return cn_fail(CN_ERR_FORMAT, "%s: the photo name at byte %zu has no end; the file is truncated", c->path,
                       c->at);
    if (!(*name = strdup((const char *)c->data + c->at))) return no_memory(c);
    c->at = (size_t)(end - c->data) + 1;
    return CN_OK;
}

static cn_status read_image(cursor *c, cn_raw_model *raw, uint64_t *capacity)
{
    cn_raw_view *view = &raw->views[raw->n_views];
    uint64_t n = 0;
    CN_TRY(take(c, &view->id, 4, "a photo"));
    CN_TRY(take(c, view->quaternion, 32, "a photo"));
    CN_TRY(take(c, view->translation, 24, "a photo"));
    CN_TRY(take(c, &view->camera_id, 4, "a photo"));
    CN_TRY(read_name(c, &view->name));
    raw->n_views++;
    CN_TRY(take_count(c, 24, "keypoints", &n));
    if (raw->n_keypoints + n > *capacity) {
        *capacity = 2 * (raw->n_keypoints + n);
        void *grown = realloc(raw->keypoints, *capacity * sizeof *raw->keypoints);
        if (!grown) return no_memory(c);
        raw->keypoints = grown;
    }
    view->first_keypoint = raw->n_keypoints;
    view->n_keypoints = n;
    for (uint64_t i = 0; i < n; i++, c->at += 24) {
        double xy[2]; /* then the point's id, which the tracks repeat */
        memcpy(xy, c->data + c->at, sizeof xy);
        raw->keypoints[raw->n_keypoints][0] = (float)xy[0];
        raw->keypoints[raw->n_keypoints++][1] = (float)xy[1];
    }
    return CN_OK;
}

static cn_status read_images(cursor *c, cn_raw_model *raw)
{
    uint64_t n = 0, capacity = 0;
    CN_TRY(take_count(c, 64 + 1 + 8, "photos", &n));
    if (!(raw->views = calloc(n + 1, sizeof *raw->views))) return no_memory(c);
    for (uint64_t i = 0; i < n; i++)
        CN_TRY(read_image(c, raw, &capacity));
    return CN_OK;
}

static cn_status read_point(cursor *c, cn_raw_model *raw, cn_point *point)
{
    uint64_t id, n = 0;
    double error = 0.0;
    CN_TRY(take(c, &id, 8, "a point"));
    CN_TRY(take(c, point->xyz, 24, "a point"));
    CN_TRY(take(c, point->rgb, 3, "a point"));
    CN_TRY(take(c, &error, 8, "a point"));
    size_t at = c->at;
    CN_TRY(take_count(c, 8, "observations of a point", &n));
    if (raw->n_tracks + n > UINT32_MAX)
        return cn_fail(CN_ERR_FORMAT, "%s: byte %zu: more than 2^32 observations", c->path, at);
    point->error_px = (float)error;
    point->first_observation = (uint32_t)raw->n_tracks;
    point->n_observations = (uint32_t)n;
    CN_TRY(take(c, raw->tracks + raw->n_tracks, n * 8, "observations of a point"));
    raw->n_tracks += n;
    return CN_OK;
}

static cn_status read_points(cursor *c, cn_raw_model *raw)
{
    uint64_t n = 0;
    CN_TRY(take_count(c, 43 + 8, "points", &n));
    raw->points = calloc(n + 1, sizeof *raw->points);
    /* The bytes that are not points' heads are tracks: an upper bound from the file's size. */
    raw->tracks = malloc(((c->size - c->at) / 8 + 1) * sizeof *raw->tracks);
    if (!raw->points || !raw->tracks) return no_memory(c);
    for (; raw->n_points < n; raw->n_points++)
        CN_TRY(read_point(c, raw, &raw->points[raw->n_points]));
    return CN_OK;
}

static cn_status read_file(cn_raw_model *raw, const char *dir, const char *name,
                           cn_status (*read)(cursor *, cn_raw_model *))
{
    char *path = cn_path_join(dir, name), *data = NULL;
    size_t size = 0;
    if (!path) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", dir);
    cn_status status = cn_file_read(path, SIZE_MAX / 4, &data, &size);
    if (status == CN_OK) {
        cursor c = { path, (const unsigned char *)data, size, 0 };
        status = read(&c, raw);
        if (status == CN_OK && c.at != c.size)
            status = cn_fail(CN_ERR_FORMAT, "%s: %zu bytes too many after byte %zu; this is not a COLMAP model file",
                             path, c.size - c.at, c.at);
    }
    free(data);
    free(path);
    return status;
}

cn_status cn_raw_read_binary(cn_raw_model *raw, const char *dir)
{
    CN_TRY(read_file(raw, dir, "cameras.bin", read_cameras));
    CN_TRY(read_file(raw, dir, "images.bin", read_images));
    return read_file(raw, dir, "points3D.bin", read_points);
}
