/* Reads transforms.json of Nerfstudio and instant-ngp. Intrinsics are in the frame or, for all frames, at the top. */
#include "base/file.h"
#include "base/json.h"
#include "base/units.h"
#include "math/linalg.h"
#include "pose/importer.h"
#include "pose/lens.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct source {
    cn_importer *to;
    const char *path; /* of the json, for messages */
    const json_t *root;
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
    if (known == CN_LENS_OPENCV_FISHEYE || known == CN_LENS_EQUIRECTANGULAR) *lens = (cn_lens)known;
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

static cn_status read_distortion(const source *from, const json_t *frame, cn_import_lens *lens)
{
    static const char *const RADIAL[4] = { "k1", "k2", "k3", "k4" }, *const TANGENTIAL[2] = { "p1", "p2" };
    for (int i = 0; i < 4; i++)
        CN_TRY(setting(from, frame, RADIAL[i], 0.0, &lens->k[i]));
    for (int i = 0; i < 2; i++)
        CN_TRY(setting(from, frame, TANGENTIAL[i], 0.0, &lens->p[i]));
    return CN_OK;
}

/* Nerfstudio writes half the width as the focal length of these. */
static cn_status read_sphere(const source *from, const json_t *frame, const cn_photo *photo, cn_camera *camera)
{
    double focal;
    char who[512];
    CN_TRY(setting(from, frame, "fl_x", 0.5 * camera->width, &focal));
    if (fabs(focal - 0.5 * camera->width) > 1.0)
        return cn_fail(CN_ERR_FORMAT,
                       "%s: photo %s is equirectangular and %u pixels wide, but fl_x is %g; of a picture of all "
                       "directions it is half the width",
                       from->path, photo->name, camera->width, focal);
    cn_importer_who(photo, who, sizeof who);
    return cn_importer_sphere(from->to, who, camera);
}

static cn_status read_camera(const source *from, const json_t *frame, const cn_photo *photo, cn_camera *camera)
{
    char who[512];
    memset(camera, 0, sizeof *camera);
    CN_TRY(choose_lens(from, frame, &camera->lens));
    CN_TRY(read_size(from, frame, photo, camera));
    if (camera->lens == CN_LENS_EQUIRECTANGULAR) return read_sphere(from, frame, photo, camera);
    cn_import_lens lens = { .fisheye = camera->lens == CN_LENS_OPENCV_FISHEYE };
    CN_TRY(focal(from, frame, photo, (focal_keys){ "fl_x", "camera_angle_x" }, camera->width, &lens.fx));
    CN_TRY(focal(from, frame, photo, (focal_keys){ "fl_y", "camera_angle_y" }, camera->height, &lens.fy));
    if (lens.fx == 0.0) lens.fx = lens.fy;
    if (lens.fy == 0.0) lens.fy = lens.fx;
    if (!(lens.fx > 0.0) || !(lens.fy > 0.0))
        return cn_fail(CN_ERR_FORMAT, "%s: photo %s has no focal length: give fl_x or camera_angle_x", from->path,
                       photo->name);
    CN_TRY(setting(from, frame, "cx", 0.5 * camera->width, &lens.cx));
    CN_TRY(setting(from, frame, "cy", 0.5 * camera->height, &lens.cy));
    CN_TRY(read_distortion(from, frame, &lens));
    cn_importer_who(photo, who, sizeof who);
    return cn_importer_lens(from->to, &lens, who, camera);
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
    if (!cn_import_rotation(r)) return not_rigid(from, file, "is not rigid (scaled, sheared or mirrored)");
    const double centre[3] = { m[3], m[7], m[11] };
    cn_mat3_transpose(r, view->rotation);
    cn_mat3_vec(view->rotation, centre, moved);
    for (int i = 0; i < 3; i++)
        view->translation[i] = -moved[i];
    return CN_OK;
}

/* Adds one frame, or counts it as missing. */
static cn_status read_frame(const source *from, const json_t *frame)
{
    const char *file;
    int64_t photo;
    cn_view view = { 0 };
    cn_camera camera;
    CN_TRY(cn_json_string(frame, from->path, "file_path", &file));
    cn_importer_find(from->to, file, &photo);
    if (photo < 0) return CN_OK;
    CN_TRY(read_pose(from, frame, file, &view));
    CN_TRY(read_camera(from, frame, &from->to->index->photos[photo], &camera));
    return cn_importer_add(from->to, photo, &camera, &view);
}

/* Nerfstudio takes COLMAP's poses, whose axes mean nothing, and exchanges these axes. It marks their frames by
 * colmap_im_id; where that is missing, z is COLMAP's -y or -z. */
static bool is_of_colmap(const json_t *root, const json_t *frames)
{
    const json_t *z = json_array_get(json_object_get(root, "applied_transform"), 2);
    if (json_object_get(json_array_get(frames, 0), "colmap_im_id")) return true;
    return json_number_value(json_array_get(z, 1)) < -0.5 || json_number_value(json_array_get(z, 2)) < -0.5;
}

static cn_status read_frames(const source *from)
{
    const json_t *frames;
    CN_TRY(cn_json_array(from->root, from->path, "frames", &frames));
    const size_t n = json_array_size(frames);
    CN_TRY(cn_importer_room(from->to, n));
    from->to->origin.arbitrary_axes = is_of_colmap(from->root, frames);
    for (size_t i = 0; i < n; i++)
        CN_TRY(read_frame(from, json_array_get(frames, i)));
    return CN_OK;
}

cn_status cn_import_transforms(cn_importer *to)
{
    json_t *root = NULL;
    CN_TRY(cn_json_load(to->path, &root));
    const source from = { to, to->path, root };
    const cn_status status = read_frames(&from);
    json_decref(root);
    return status;
}
