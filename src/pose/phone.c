/* Reads the poses that phones store beside their photos by ARKit: folders of Polycam (a JSON file a photo) and the
 * metadata of Record3D (one JSON file for all). Both have the camera's axes of OpenGL (x right, y up, z backward) in a
 * world whose y is up; here z is up. */
#include "base/file.h"
#include "base/json.h"
#include "math/linalg.h"
#include "pose/import_files.h"
#include "pose/importer.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* world_from_cam as ARKit has it: 3 rows of 4. The axes of the world x, y, z become y, z, x. */
static cn_status add(cn_importer *to, int64_t photo, const double m[12], const cn_camera *camera)
{
    double world[9], moved[3];
    cn_view view = { 0 };
    const double centre[3] = { m[11], m[3], m[7] };
    for (int row = 0; row < 3; row++)
        for (int c = 0; c < 3; c++)
            world[3 * row + c] = (c ? -1 : 1) * m[4 * ((row + 2) % 3) + c];
    if (!cn_import_rotation(world))
        return cn_fail(CN_ERR_FORMAT, "%s: the pose of photo %s is no rotation (scaled, sheared or mirrored)", to->path,
                       to->index->photos[photo].name);
    cn_mat3_transpose(world, view.rotation);
    cn_mat3_vec(view.rotation, centre, moved);
    for (int k = 0; k < 3; k++)
        view.translation[k] = -moved[k];
    return cn_importer_add(to, photo, camera, &view);
}

static cn_status make_camera(cn_importer *to, int64_t photo, const double size[2], const double k[4], cn_camera *camera)
{
    char who[512];
    const cn_import_lens lens = { .fx = k[0], .fy = k[1], .cx = k[2], .cy = k[3] };
    cn_importer_who(&to->index->photos[photo], who, sizeof who);
    if (!(size[0] >= 1.0 && size[0] < 1e6 && size[1] >= 1.0 && size[1] < 1e6))
        return cn_fail(CN_ERR_FORMAT, "%s: %s: %g x %g is no size in pixels", to->path, who, size[0], size[1]);
    *camera = (cn_camera){ .width = (uint32_t)size[0], .height = (uint32_t)size[1] };
    return cn_importer_lens(to, &lens, who, camera);
}

/* ---- Polycam ---- */

static cn_status read_keyframe(cn_importer *to, const json_t *root, const char *file, int64_t photo)
{
    static const char *const INTRINSICS[4] = { "fx", "fy", "cx", "cy" }, *const SIZES[2] = { "width", "height" };
    double k[4], size[2], m[12];
    cn_camera camera;
    for (int i = 0; i < 4; i++)
        CN_TRY(cn_json_number(root, file, INTRINSICS[i], &k[i]));
    for (int i = 0; i < 2; i++)
        CN_TRY(cn_json_number(root, file, SIZES[i], &size[i]));
    for (int i = 0; i < 12; i++) {
        char key[16];
        snprintf(key, sizeof key, "t_%d%d", i / 4, i % 4);
        CN_TRY(cn_json_number(root, file, key, &m[i]));
    }
    CN_TRY(make_camera(to, photo, size, k, &camera));
    return add(to, photo, m, &camera);
}

static cn_status read_file(cn_importer *to, const char *file)
{
    json_t *root = NULL;
    int64_t photo;
    char *stem = strdup(cn_path_base(file));
    if (!stem) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", to->path);
    cn_status status = CN_OK;
    *strrchr(stem, '.') = '\0';
    cn_importer_find(to, stem, &photo);
    if (photo >= 0) status = cn_json_load(file, &root);
    if (status == CN_OK && photo >= 0) status = read_keyframe(to, root, file, photo);
    json_decref(root);
    free(stem);
    return status;
}

cn_status cn_import_polycam(cn_importer *to)
{
    cn_import_files files = { 0 };
    cn_status status = cn_import_files_add_json(&files, to->path);
    if (status == CN_OK)
        status = files.n ? cn_importer_room(to, files.n)
                         : cn_fail(CN_ERR_DATA, "%s: it has no .json file of a photo", to->path);
    for (uint32_t i = 0; i < files.n && status == CN_OK; i++)
        status = read_file(to, files.paths[i]);
    cn_import_files_deinit(&files);
    return status;
}

/* ---- Record3D ---- */

static cn_status read_shot(cn_importer *to, const json_t *pose, size_t i, const double size[2], const double k[4])
{
    enum { NUMBERS = 7 };
    double v[NUMBERS], rotation[9], m[12];
    char name[32];
    int64_t photo;
    cn_camera camera;
    for (size_t j = 0; j < NUMBERS; j++) {
        const json_t *item = json_array_get(pose, j);
        v[j] = json_is_number(item) ? json_number_value(item) : NAN;
        if (json_array_size(pose) != NUMBERS || !isfinite(v[j]))
            return cn_fail(CN_ERR_FORMAT, "%s: pose %zu is not the seven numbers qx, qy, qz, qw, x, y, z", to->path, i);
    }
    const double q[4] = { v[3], v[0], v[1], v[2] };
    if (!(fabs(sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]) - 1.0) < 1e-2))
        return cn_fail(CN_ERR_FORMAT, "%s: the quaternion of pose %zu has not the length 1", to->path, i);
    snprintf(name, sizeof name, "%zu", i);
    cn_importer_find(to, name, &photo);
    if (photo < 0) return CN_OK;
    cn_quat_to_mat3(q, rotation);
    for (int row = 0; row < 3; row++) {
        memcpy(m + 4 * row, rotation + 3 * row, 3 * sizeof *m);
        m[4 * row + 3] = v[4 + row];
    }
    CN_TRY(make_camera(to, photo, size, k, &camera));
    return add(to, photo, m, &camera);
}

static cn_status read_metadata(cn_importer *to, const json_t *root)
{
    double matrix[9], size[2];
    const json_t *poses;
    CN_TRY(cn_json_numbers(root, to->path, "K", matrix, 9)); /* column by column */
    CN_TRY(cn_json_number(root, to->path, "w", &size[0]));
    CN_TRY(cn_json_number(root, to->path, "h", &size[1]));
    CN_TRY(cn_json_array(root, to->path, "poses", &poses));
    const double k[4] = { matrix[0], matrix[4], matrix[6], matrix[7] };
    CN_TRY(cn_importer_room(to, json_array_size(poses)));
    for (size_t i = 0; i < json_array_size(poses); i++)
        CN_TRY(read_shot(to, json_array_get(poses, i), i, size, k));
    return CN_OK;
}

cn_status cn_import_record3d(cn_importer *to)
{
    json_t *root = NULL;
    CN_TRY(cn_json_load(to->path, &root));
    const cn_status status = read_metadata(to, root);
    json_decref(root);
    return status;
}
