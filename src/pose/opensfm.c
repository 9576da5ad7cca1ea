/* Reads reconstruction.json of OpenSfM, which ODM writes too. Lengths in pictures are fractions of the longer side; the
 * world is east-north-up about reference_lla. Poses are for the stored pixels: OpenSfM ignores the EXIF orientation. */
#include "base/file.h"
#include "base/json.h"
#include "math/linalg.h"
#include "pose/importer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct source {
    cn_importer *to;
    const json_t *cameras;
} source;

/* The lens models by the keys that each one has. */
typedef struct projection {
    const char *name;
    bool fisheye, one_focal; /* one_focal: "focal"; else "focal_x" and "focal_y" */
    int n_radial;
    bool centre, tangential, sphere; /* sphere: all directions, no numbers */
} projection;
static const projection PROJECTIONS[] = {
    { "perspective", false, true, 2, false, false, false }, { "simple_radial", false, false, 1, true, false, false },
    { "radial", false, false, 2, true, false, false },      { "brown", false, false, 3, true, true, false },
    { "fisheye", true, true, 2, false, false, false },      { "fisheye_opencv", true, false, 4, true, false, false },
    { "spherical", false, false, 0, false, false, true },   { "equirectangular", false, false, 0, false, false, true },
};

static cn_status choose(const source *from, const json_t *camera, const char *id, const projection **out)
{
    const char *name;
    CN_TRY(cn_json_string(camera, from->to->path, "projection_type", &name));
    for (size_t i = 0; i < sizeof PROJECTIONS / sizeof *PROJECTIONS; i++) {
        *out = &PROJECTIONS[i];
        if (strcmp(name, PROJECTIONS[i].name) == 0) return CN_OK;
    }
    return cn_fail(CN_ERR_FORMAT,
                   "%s: camera %s is of type %s; supported are perspective, simple_radial, radial, brown, fisheye, "
                   "fisheye_opencv, spherical and equirectangular",
                   from->to->path, id, name);
}

static cn_status read_lens(const source *from, const json_t *camera, const projection *type, cn_camera *out,
                           cn_import_lens *lens)
{
    static const char *const RADIAL[4] = { "k1", "k2", "k3", "k4" }, *const TANGENTIAL[2] = { "p1", "p2" };
    const char *path = from->to->path;
    int64_t width, height;
    CN_TRY(cn_json_integer(camera, path, "width", &width));
    CN_TRY(cn_json_integer(camera, path, "height", &height));
    if (width < 1 || width > 1000000 || height < 1 || height > 1000000)
        return cn_fail(CN_ERR_FORMAT, "%s: a camera is %lld x %lld pixels, which is no size of a photo", path,
                       (long long)width, (long long)height);
    *out = (cn_camera){ .width = (uint32_t)width, .height = (uint32_t)height };
    *lens = (cn_import_lens){ .fisheye = type->fisheye };
    if (type->sphere) return CN_OK;
    CN_TRY(cn_json_number(camera, path, type->one_focal ? "focal" : "focal_x", &lens->fx));
    /* Files of old versions call the one focal length of every model "focal". */
    CN_TRY(cn_json_number_or(camera, path, "focal_y", lens->fx, &lens->fy));
    if (type->one_focal) lens->fy = lens->fx;
    if (type->centre) {
        CN_TRY(cn_json_number_or(camera, path, "c_x", 0.0, &lens->cx));
        CN_TRY(cn_json_number_or(camera, path, "c_y", 0.0, &lens->cy));
    }
    for (int i = 0; i < type->n_radial; i++)
        CN_TRY(cn_json_number_or(camera, path, RADIAL[i], 0.0, &lens->k[i]));
    for (int i = 0; i < 2 && type->tangential; i++)
        CN_TRY(cn_json_number_or(camera, path, TANGENTIAL[i], 0.0, &lens->p[i]));
    const double size = fmax(out->width, out->height);
    lens->fx *= size;
    lens->fy *= size;
    lens->cx = lens->cx * size + 0.5 * out->width;
    lens->cy = lens->cy * size + 0.5 * out->height;
    return CN_OK;
}

static cn_status read_camera(const source *from, const json_t *shot, const char *name, cn_camera *out)
{
    const char *id;
    const projection *type;
    cn_import_lens lens;
    CN_TRY(cn_json_string(shot, from->to->path, "camera", &id));
    const json_t *camera = json_object_get(from->cameras, id);
    if (!json_is_object(camera))
        return cn_fail(CN_ERR_FORMAT, "%s: photo %s names camera \"%s\", which does not exist", from->to->path, name,
                       id);
    CN_TRY(choose(from, camera, id, &type));
    CN_TRY(read_lens(from, camera, type, out, &lens));
    char *who = cn_format("photo %s", name);
    const cn_status status = !who           ? cn_fail(CN_ERR_NOMEM, "out of memory")
                             : type->sphere ? cn_importer_sphere(from->to, who, out)
                                            : cn_importer_lens(from->to, &lens, who, out);
    free(who);
    return status;
}

static cn_status read_shot(const source *from, const char *name, const json_t *shot)
{
    int64_t photo;
    double turn[3];
    cn_view view = { 0 };
    cn_camera camera;
    cn_importer_find(from->to, name, &photo);
    if (photo < 0) return CN_OK;
    char *where = cn_format("%s, photo %s", from->to->path, name);
    if (!where) return cn_fail(CN_ERR_NOMEM, "out of memory");
    cn_status status = cn_json_numbers(shot, where, "rotation", turn, 3);
    if (status == CN_OK) status = cn_json_numbers(shot, where, "translation", view.translation, 3);
    free(where);
    CN_TRY(status);
    cn_turn_to_mat3(turn, view.rotation);
    CN_TRY(read_camera(from, shot, name, &camera));
    return cn_importer_add(from->to, photo, &camera, &view);
}

static cn_status read_origin(const source *from, const json_t *part)
{
    const json_t *place = json_object_get(part, "reference_lla");
    cn_import_origin *origin = &from->to->origin;
    if (!place) return CN_OK;
    char *where = cn_format("%s, reference_lla", from->to->path);
    if (!where) return cn_fail(CN_ERR_NOMEM, "out of memory");
    cn_status status = cn_json_number(place, where, "latitude", &origin->latitude_deg);
    if (status == CN_OK) status = cn_json_number(place, where, "longitude", &origin->longitude_deg);
    if (status == CN_OK) status = cn_json_number_or(place, where, "altitude", 0.0, &origin->height_m);
    if (status == CN_OK && !(fabs(origin->latitude_deg) <= 90.0 && fabs(origin->longitude_deg) <= 360.0))
        status = cn_fail(CN_ERR_FORMAT, "%s: %g, %g is not a place on Earth", where, origin->latitude_deg,
                         origin->longitude_deg);
    free(where);
    CN_TRY(status);
    origin->known = origin->sea_level = true;
    return CN_OK;
}

static cn_status read_part(cn_importer *to, const json_t *part)
{
    const source from = { to, json_object_get(part, "cameras") };
    const json_t *shots = json_object_get(part, "shots"), *shot;
    const char *name;
    CN_TRY(cn_importer_room(to, json_object_size(shots)));
    CN_TRY(read_origin(&from, part));
    json_object_foreach((json_t *)shots, name, shot) CN_TRY(read_shot(&from, name, shot));
    return CN_OK;
}

/* The reconstruction with the most photos. */
cn_status cn_import_opensfm(cn_importer *to)
{
    json_t *root = NULL;
    const json_t *best = NULL;
    size_t most = 0;
    CN_TRY(cn_json_load(to->path, &root));
    for (size_t i = 0; i < json_array_size(root); i++) {
        const json_t *part = json_array_get(root, i);
        const size_t n = json_object_size(json_object_get(part, "shots"));
        if (n > most) best = part;
        if (n > most) most = n;
    }
    to->n_models = (uint32_t)json_array_size(root);
    const cn_status status =
        best ? read_part(to, best)
             : cn_fail(CN_ERR_FORMAT,
                       "%s: no reconstruction with shots; give the reconstruction.json of OpenSfM or ODM", to->path);
    json_decref(root);
    return status;
}
