/* Converts COLMAP's ids to indices. */
#include "math/linalg.h"
#include "pose/lens.h"
#include "pose/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct id_entry {
    uint32_t id, index;
} id_entry;

static int compare_ids(const void *a, const void *b)
{
    uint32_t x = ((const id_entry *)a)->id, y = ((const id_entry *)b)->id;
    return (x > y) - (x < y);
}

static uint32_t find_id(const id_entry *map, uint32_t n, uint32_t id)
{
    id_entry key = { id, 0 };
    const id_entry *found = n ? bsearch(&key, map, n, sizeof *map, compare_ids) : NULL;
    return found ? found->index : UINT32_MAX;
}

static cn_status sort_ids(id_entry *map, uint32_t n, const char *what, const char *where)
{
    if (n) qsort(map, n, sizeof *map, compare_ids);
    for (uint32_t i = 1; i < n; i++)
        if (map[i].id == map[i - 1].id)
            return cn_fail(CN_ERR_FORMAT, "%s: %s id %u appears twice", where, what, map[i].id);
    return CN_OK;
}

void cn_raw_model_deinit(cn_raw_model *raw)
{
    for (uint32_t i = 0; i < raw->n_views && raw->views; i++)
        free(raw->views[i].name);
    free(raw->cameras);
    free(raw->views);
    free(raw->keypoints);
    free(raw->points);
    free(raw->tracks);
    memset(raw, 0, sizeof *raw);
}

static cn_status take_views(cn_scene *scene, cn_raw_model *raw, const id_entry *cameras, const char *where)
{
    scene->views = calloc(raw->n_views + (size_t)1, sizeof *scene->views);
    if (!scene->views) return cn_fail(CN_ERR_NOMEM, "%s: out of memory for %u photos", where, raw->n_views);
    for (uint32_t i = 0; i < raw->n_views; i++) {
        cn_raw_view *from = &raw->views[i];
        cn_view *to = &scene->views[i];
        double length = 0.0;
        for (int k = 0; k < 4; k++)
            length += from->quaternion[k] * from->quaternion[k];
        bool finite = isfinite(length) && length > 1e-12;
        for (int k = 0; k < 3; k++)
            finite = finite && isfinite(from->translation[k]);
        if (!finite) return cn_fail(CN_ERR_FORMAT, "%s: photo %s has no valid pose", where, from->name);
        to->camera = find_id(cameras, raw->n_cameras, from->camera_id);
        if (to->camera == UINT32_MAX)
            return cn_fail(CN_ERR_FORMAT, "%s: photo %s names camera %u, which does not exist", where, from->name,
                           from->camera_id);
        to->photo = UINT32_MAX;
        cn_quat_to_mat3(from->quaternion, to->rotation);
        memcpy(to->translation, from->translation, sizeof to->translation);
        to->name = from->name;
        from->name = NULL;
        scene->n_views = i + 1;
    }
    return CN_OK;
}

static cn_status take_observations(cn_scene *scene, const cn_raw_model *raw, const id_entry *views, const char *where)
{
    scene->observations = calloc(raw->n_tracks + (size_t)1, sizeof *scene->observations);
    if (!scene->observations)
        return cn_fail(CN_ERR_NOMEM, "%s: out of memory for %llu observations", where,
                       (unsigned long long)raw->n_tracks);
    for (uint64_t i = 0; i < raw->n_tracks; i++) {
        cn_raw_track track = raw->tracks[i];
        uint32_t view = find_id(views, raw->n_views, track.view_id);
        if (view == UINT32_MAX)
            return cn_fail(CN_ERR_FORMAT, "%s: a point names photo id %u, which does not exist", where, track.view_id);
        const cn_raw_view *seen = &raw->views[view];
        if (track.keypoint >= seen->n_keypoints)
            return cn_fail(CN_ERR_FORMAT, "%s: a point names keypoint %u of photo %s, which has %llu", where,
                           track.keypoint, scene->views[view].name, (unsigned long long)seen->n_keypoints);
        const float *at = raw->keypoints[seen->first_keypoint + track.keypoint];
        scene->observations[i] = (cn_observation){ view, at[0], at[1] };
    }
    scene->n_observations = raw->n_tracks;
    return CN_OK;
}

static cn_status check_points(const cn_raw_model *raw, const char *where)
{
    for (uint32_t i = 0; i < raw->n_points; i++) {
        const double *p = raw->points[i].xyz;
        if (!isfinite(p[0]) || !isfinite(p[1]) || !isfinite(p[2]))
            return cn_fail(CN_ERR_FORMAT, "%s: sparse point number %u is not finite", where, i);
    }
    return CN_OK;
}

static cn_status check_names(const cn_scene *scene, const char *where)
{
    for (uint32_t i = 1; i < scene->n_views; i++)
        if (strcmp(scene->views[i].name, scene->views[i - 1].name) == 0)
            return cn_fail(CN_ERR_FORMAT, "%s: photo %s appears twice", where, scene->views[i].name);
    return CN_OK;
}

static cn_status fill(cn_scene *scene, cn_raw_model *raw, id_entry *cameras, id_entry *views, const char *where)
{
    for (uint32_t i = 0; i < raw->n_cameras; i++) {
        CN_TRY(cn_camera_check(&raw->cameras[i], where));
        cameras[i] = (id_entry){ raw->cameras[i].id, i };
    }
    for (uint32_t i = 0; i < raw->n_views; i++)
        views[i] = (id_entry){ raw->views[i].id, i };
    CN_TRY(sort_ids(cameras, raw->n_cameras, "camera", where));
    CN_TRY(sort_ids(views, raw->n_views, "photo", where));
    CN_TRY(check_points(raw, where));
    CN_TRY(take_views(scene, raw, cameras, where));
    CN_TRY(take_observations(scene, raw, views, where));
    scene->cameras = raw->cameras;
    scene->n_cameras = raw->n_cameras;
    scene->points = raw->points;
    scene->n_points = raw->n_points;
    raw->cameras = NULL;
    raw->points = NULL;
    CN_TRY(cn_scene_sort_views(scene));
    return check_names(scene, where);
}

cn_status cn_scene_from_raw(cn_scene *scene, cn_raw_model *raw, const char *where)
{
    memset(scene, 0, sizeof *scene);
    id_entry *cameras = calloc(raw->n_cameras + (size_t)1, sizeof *cameras);
    id_entry *views = calloc(raw->n_views + (size_t)1, sizeof *views);
    cn_status status =
        cameras && views ? fill(scene, raw, cameras, views, where) : cn_fail(CN_ERR_NOMEM, "%s: out of memory", where);
    free(cameras);
    free(views);
    if (status != CN_OK) cn_scene_deinit(scene);
    return status;
}

cn_status cn_raw_set_lens(cn_raw_model *raw, cn_camera *camera, int lens, const double *params, const char *path)
{
    double error_px = 0;
    if (cn_lens_is_known(lens)) {
        camera->lens = (cn_lens)lens;
        memcpy(camera->params, params, (size_t)cn_lens_params(camera->lens) * sizeof *params);
        return CN_OK;
    }
    CN_TRY(cn_lens_from_foreign(lens, params, camera, path, &error_px));
    if (error_px > raw->lens_fit_px) raw->lens_fit_px = error_px;
    return CN_OK;
}
