/* Reads transforms.json of Nerfstudio and instant-ngp. Intrinsics are in the frame or, for all frames, at the top. */
#include "base/file.h"
#include "base/json.h"
#include "base/units.h"
#include "math/linalg.h"
#include "pose/finder.h"
#include "pose/lens.h"
#include "pose/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define NAMED_AT_MOST 5

typedef struct source {
    const char *path; /* of the json, for messages */
    char *folder;     /* absolute, of the json */
    const json_t *root;
    const cn_photo_index *index;
    cn_photo_finder finder;
} source;

/* A number of the frame or of the file; `fallback` when absent. */
static cn_status setting(const source *from, const json_t *frame, const char *key, double fallback, double *value)
{
    const json_t *holder = json_object_get(frame, key) ? frame : from->root;
    CN_TRY(cn_json_number_or(holder, from->path, key, fallback, value));
    return CN_OK;
}

static cn_status choose_lens(const source *from, const json_t *frame, cn_lens *lens)
{
    const json_t *model = json_object_get(frame, "camera_model"), *fisheye = json_object_get(frame, "is_fisheye");
    if (!model) model = json_object_get(from->root, "camera_model");
    if (!fisheye) fisheye = json_object_get(from->root, "is_fisheye");
    *lens = json_is_true(fisheye) ? CN_LENS_OPENCV_FISHEYE : CN_LENS_OPENCV;
    if (!json_is_string(model)) return CN_OK;
    int known = cn_lens_from_name(json_string_value(model));
    if (known < 0)
        return cn_fail(CN_ERR_FORMAT, "%s: camera_model %s is not supported; supported are " CN_LENS_NAMES, from->path,
                       json_string_value(model));
    if (known == CN_LENS_OPENCV_FISHEYE) *lens = CN_LENS_OPENCV_FISHEYE;
    return CN_OK;
}

typedef struct focal_keys {
    const char *length, *angle;
} focal_keys;

/* Focal length in pixels from fl_x or camera_angle_x (or y); 0 when both are absent. The first wins. */
static cn_status focal(const source *from, const json_t *frame, const cn_photo *photo, focal_keys key, double size,
                       double *value)
{
    const bool has_length = json_object_get(frame, key.length) || json_object_get(from->root, key.length);
    const bool has_angle = json_object_get(frame, key.angle) || json_object_get(from->root, key.angle);
    double angle;
    CN_TRY(setting(from, frame, key.length, 0.0, value));
    CN_TRY(setting(from, frame, key.angle, 0.0, &angle));
    if (has_length && !(*value > 0.0))
        return cn_fail(CN_ERR_FORMAT, "%s: photo %s: %s is %g, but a focal length is more than 0 pixels", from->path,
                       photo->name, key.length, *value);
    if (has_length || !has_angle) return CN_OK;
    if (!(angle > 0.0 && angle < CN_PI))
        return cn_fail(CN_ERR_FORMAT, "%s: photo %s: %s is %g; it must lie between 0 and pi radians", from->path,
                       photo->name, key.angle, angle);
    *value = 0.5 * size / tan(0.5 * angle);
    return CN_OK;
}

static cn_status read_size(const source *from, const json_t *frame, const cn_photo *photo, cn_camera *camera)
{
    double w, h;
    CN_TRY(setting(from, frame, "w", photo->width, &w));
    CN_TRY(setting(from, frame, "h", photo->height, &h));
    if (!(w >= 1.0 && w < 1e6 && h >= 1.0 && h < 1e6))
        return cn_fail(CN_ERR_FORMAT, "%s: w %g and h %g of photo %s are not a size in pixels", from->path, w, h,
                       photo->name);
    camera->width = (uint32_t)w;
    camera->height = (uint32_t)h;
    return CN_OK;
}

static cn_status read_distortion(const source *from, const json_t *frame, const cn_photo *photo, cn_lens_view *lens)
{
    static const char *const RADIAL[4] = { "k1", "k2", "k3", "k4" }, *const TANGENTIAL[2] = { "p1", "p2" };
    for (int i = 0; i < 4; i++)
        CN_TRY(setting(from, frame, RADIAL[i], 0.0, &lens->k[i]));
    for (int i = 0; i < 2; i++)
        CN_TRY(setting(from, frame, TANGENTIAL[i], 0.0, &lens->p[i]));
    if (!lens->fisheye && (lens->k[2] != 0.0 || lens->k[3] != 0.0))
        return cn_fail(CN_ERR_FORMAT,
                       "%s: photo %s: k3 or k4 is supported only for a fisheye lens; "
                       "supported are " CN_LENS_NAMES,
                       from->path, photo->name);
    return CN_OK;
}

static cn_status read_camera(const source *from, const json_t *frame, const cn_photo *photo, cn_camera *camera)
{
    memset(camera, 0, sizeof *camera);
    CN_TRY(choose_lens(from, frame, &camera->lens));
    CN_TRY(read_size(from, frame, photo, camera));
    cn_lens_view lens = { .fisheye = camera->lens == CN_LENS_OPENCV_FISHEYE };
    CN_TRY(focal(from, frame, photo, (focal_keys){ "fl_x", "camera_angle_x" }, camera->width, &lens.fx));
    CN_TRY(focal(from, frame, photo, (focal_keys){ "fl_y", "camera_angle_y" }, camera->height, &lens.fy));
    if (lens.fx == 0.0) lens.fx = lens.fy;
    if (lens.fy == 0.0) lens.fy = lens.fx;
    if (!(lens.fx > 0.0) || !(lens.fy > 0.0))
        return cn_fail(CN_ERR_FORMAT, "%s: photo %s has no focal length: give fl_x or camera_angle_x", from->path,
                       photo->name);
    CN_TRY(setting(from, frame, "cx", 0.5 * camera->width, &lens.cx));
    CN_TRY(setting(from, frame, "cy", 0.5 * camera->height, &lens.cy));
    CN_TRY(read_distortion(from, frame, photo, &lens));
    bool straight = !lens.fisheye && lens.k[0] == 0.0 && lens.k[1] == 0.0 && lens.p[0] == 0.0 && lens.p[1] == 0.0;
    if (straight) camera->lens = CN_LENS_PINHOLE;
    cn_lens_pack(&lens, camera);
    CN_TRY(cn_camera_check(camera, from->path));
    char *who = cn_format("photo %s", photo->name);
    const cn_status status =
        who ? cn_camera_check_inverse(camera, from->path, who) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(who);
    return status;
}

static cn_status not_rigid(const source *from, const char *file, const char *why)
{
    return cn_fail(CN_ERR_FORMAT,
                   "%s: transform_matrix of %s %s; it must be a camera-to-world rotation and "
                   "translation",
                   from->path, file, why);
}

static cn_status read_matrix(const source *from, const json_t *frame, const char *file, double m[12])
{
    const json_t *rows = json_object_get(frame, "transform_matrix");
    size_t n_rows = json_array_size(rows);
    if (n_rows != 3 && n_rows != 4) return not_rigid(from, file, "is not 4 x 4 (or 3 x 4) numbers");
    for (size_t i = 0; i < n_rows; i++) {
        const json_t *row = json_array_get(rows, i);
        if (json_array_size(row) != 4) return not_rigid(from, file, "is not 4 x 4 (or 3 x 4) numbers");
        for (size_t j = 0; j < 4; j++) {
            const json_t *item = json_array_get(row, j);
            double value = json_is_number(item) ? json_number_value(item) : NAN;
            if (!isfinite(value)) return not_rigid(from, file, "is not finite");
            if (i < 3)
                m[4 * i + j] = value;
            else if (fabs(value - (j == 3)) > 1e-6)
                return not_rigid(from, file, "has a last row other than 0 0 0 1");
        }
    }
    return CN_OK;
}

/* The nearest rotation, by Newton's iteration R <- (R + R^-T) / 2. False where r is far from being one. */
static bool orthonormalise(double r[9])
{
    enum { ROUNDS = 8 };
    double rt[9], gram[9];
    cn_mat3_transpose(r, rt);
    cn_mat3_mul(rt, r, gram);
    for (int i = 0; i < 9; i++)
        if (!(fabs(gram[i] - (i % 4 == 0)) < 1e-2)) return false;
    for (int round = 0; round < ROUNDS; round++) {
        double cofactor[9];
        cn_cross3(r + 3, r + 6, cofactor);
        cn_cross3(r + 6, r, cofactor + 3);
        cn_cross3(r, r + 3, cofactor + 6);
        double determinant = cn_dot3(r, cofactor);
        if (!(determinant > 0.5)) return false; /* a mirror */
        for (int i = 0; i < 9; i++)
            r[i] = 0.5 * (r[i] + cofactor[i] / determinant);
    }
    return true;
}

/* world_from_cam with OpenGL's camera (y up, z backward) -> cam_from_world with OpenCV's (y down, z forward). */
static cn_status read_pose(const source *from, const json_t *frame, const char *file, cn_view *view)
{
    double m[12], r[9], moved[3];
    CN_TRY(read_matrix(from, frame, file, m));
    for (int i = 0; i < 3; i++) {
        r[3 * i] = m[4 * i];
        r[3 * i + 1] = -m[4 * i + 1];
        r[3 * i + 2] = -m[4 * i + 2];
    }
    if (!orthonormalise(r)) return not_rigid(from, file, "is not rigid (scaled, sheared or mirrored)");
    const double centre[3] = { m[3], m[7], m[11] };
    cn_mat3_transpose(r, view->rotation);
    cn_mat3_vec(view->rotation, centre, moved);
    for (int i = 0; i < 3; i++)
        view->translation[i] = -moved[i];
    return CN_OK;
}

/* file_path as a name of the index: relative to the photo folder when it is inside. */
static int64_t find_exact(const source *from, const char *file)
{
    size_t n = strlen(from->index->folder);
    char *full = file[0] == '/' ? strdup(file) : cn_path_join(from->folder, file);
    int64_t found = -1;
    if (full && strncmp(full, from->index->folder, n) == 0 && full[n] == '/')
        found = cn_photo_finder_find(&from->finder, full + n + 1);
    free(full);
    if (found < 0) found = cn_photo_finder_find(&from->finder, file);
    return found < 0 ? cn_photo_finder_find(&from->finder, cn_path_base(file)) : found;
}

static int64_t find_photo(const source *from, const char *file)
{
    static const char *const EXTENSIONS[] = { "png", "jpg", "jpeg", "PNG", "JPG", "JPEG", "tif", "tiff", "exr" };
    while (strncmp(file, "./", 2) == 0)
        file += 2;
    int64_t found = find_exact(from, file);
    for (size_t i = 0; i < sizeof EXTENSIONS / sizeof *EXTENSIONS && found < 0; i++) {
        char *named = cn_format("%s.%s", file, EXTENSIONS[i]);
        if (named) found = find_exact(from, named);
        free(named);
    }
    return found;
}

/* Adds one frame, or counts it as missing. */
static cn_status read_frame(const cn_context *ctx, const source *from, const json_t *frame, cn_scene *scene,
                            uint32_t *n_missing)
{
    const char *file;
    CN_TRY(cn_json_string(frame, from->path, "file_path", &file));
    int64_t photo = find_photo(from, file);
    if (photo < 0) {
        if ((*n_missing)++ < NAMED_AT_MOST)
            cn_log(ctx, CN_LOG_WARN, "%s: photo %s is not in the collection; left out", from->path, file);
        return CN_OK;
    }
    cn_view *view = &scene->views[scene->n_views];
    cn_camera *camera = &scene->cameras[scene->n_cameras];
    CN_TRY(read_pose(from, frame, file, view));
    CN_TRY(read_camera(from, frame, &from->index->photos[photo], camera));
    camera->id = scene->n_cameras + 1;
    view->photo = (uint32_t)photo;
    view->camera = scene->n_cameras++;
    view->name = strdup(from->index->photos[photo].name);
    if (!view->name) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", from->path);
    scene->n_views++;
    return CN_OK;
}

static cn_status check_names(const source *from, const cn_scene *scene)
{
    for (uint32_t i = 1; i < scene->n_views; i++)
        if (strcmp(scene->views[i].name, scene->views[i - 1].name) == 0)
            return cn_fail(CN_ERR_FORMAT, "%s: two frames name photo %s; remove one", from->path, scene->views[i].name);
    return CN_OK;
}

/* Merges equal cameras and resizes them to the photos; the photos' orientation is applied. */
static cn_status finish(const cn_context *ctx, const source *from, cn_scene *scene)
{
    CN_TRY(cn_scene_sort_views(scene));
    CN_TRY(check_names(from, scene));
    bool *keep = malloc(scene->n_views + (size_t)1);
    if (!keep) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", from->path);
    memset(keep, true, scene->n_views);
    cn_status status = cn_scene_fit_photos(ctx, scene, from->index, false, keep);
    if (status == CN_OK) status = cn_scene_keep_views(scene, keep);
    free(keep);
    return status;
}

static cn_status read_frames(const cn_context *ctx, const source *from, cn_scene *scene)
{
    const json_t *frames;
    uint32_t n_missing = 0;
    CN_TRY(cn_json_array(from->root, from->path, "frames", &frames));
    size_t n = json_array_size(frames);
    scene->views = calloc(n + 1, sizeof *scene->views);
    scene->cameras = calloc(n + 1, sizeof *scene->cameras);
    if (!scene->views || !scene->cameras) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", from->path);
    for (size_t i = 0; i < n; i++)
        CN_TRY(read_frame(ctx, from, json_array_get(frames, i), scene, &n_missing));
    if (n_missing)
        cn_log(ctx, CN_LOG_WARN, "%s: %u of %zu frames name photos that are not in the collection; they are left out",
               from->path, n_missing, n);
    if (scene->n_views == 0)
        return cn_fail(CN_ERR_DATA,
                       "%s: none of its %zu frames names a photo in %s; give the folder that it was made "
                       "for",
                       from->path, n, from->index->folder);
    return finish(ctx, from, scene);
}

cn_status cn_scene_read_transforms(const cn_context *ctx, cn_scene *scene, const char *path,
                                   const cn_photo_index *index)
{
    json_t *root = NULL;
    char *absolute = NULL;
    memset(scene, 0, sizeof *scene);
    CN_TRY(cn_path_absolute(path, &absolute));
    cn_status status = cn_json_load(path, &root);
    if (status == CN_OK) {
        *strrchr(absolute, '/') = '\0';
        source from = { path, absolute, root, index, { 0 } };
        status = cn_photo_finder_init(&from.finder, index);
        if (status == CN_OK) status = read_frames(ctx, &from, scene);
        cn_photo_finder_deinit(&from.finder);
    }
    json_decref(root);
    free(absolute);
    if (status != CN_OK) cn_scene_deinit(scene);
    return status;
}
