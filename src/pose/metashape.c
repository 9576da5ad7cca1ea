/* Reads cameras.xml of Agisoft Metashape ("Export Cameras"). A camera's transform takes it to its chunk, whose
 * transform, or that of the camera's component, goes on to the world: mostly geocentric metres. Cameras are as OpenCV's
 * (x right, y down, z forward); cx and cy are measured from the middle of the photo, P1 is OpenCV's p2, and P2 its p1.
 * Poses are for the stored pixels. */
#include "base/file.h"
#include "base/units.h"
#include "geo/crs.h"
#include "math/linalg.h"
#include "pose/importer.h"
#include "pose/metashape_xml.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define EARTH_LEAST_M 6.3e6 /* distance of places on Earth from its centre */
#define EARTH_MOST_M 6.4e6

static const cn_metashape_sensor *sensor_of(const cn_metashape *file, const cn_metashape_shot *shot)
{
    for (size_t i = 0; i < file->n_sensors; i++)
        if (file->sensors[i].chunk == shot->chunk && file->sensors[i].id == shot->sensor) return &file->sensors[i];
    return NULL;
}

static const cn_metashape_part *part_of(const cn_metashape *file, int chunk, long component)
{
    const cn_metashape_part *found = NULL;
    for (size_t i = 0; i < file->n_parts; i++) {
        const cn_metashape_part *part = &file->parts[i];
        if (part->chunk != chunk || (part->component >= 0 && part->component != component)) continue;
        if (!found || part->component >= 0) found = part;
    }
    return found;
}

static bool is_used(const cn_metashape_shot *shot)
{
    return shot->enabled && shot->aligned;
}

/* Cameras of other chunks and components are in coordinates of their own. */
static bool is_together(const cn_metashape_shot *a, const cn_metashape_shot *b)
{
    return a->chunk == b->chunk && a->component == b->component;
}

/* The group of cameras with the most photos; NULL: none is aligned. */
static const cn_metashape_shot *largest(const cn_metashape *file, uint32_t *n_groups)
{
    const cn_metashape_shot *best = NULL;
    size_t most = 0;
    *n_groups = 0;
    for (size_t i = 0; i < file->n_shots; i++) {
        const cn_metashape_shot *first = &file->shots[i];
        size_t n = 0;
        bool seen = false;
        for (size_t j = 0; j < i && !seen; j++)
            seen = is_used(&file->shots[j]) && is_together(&file->shots[j], first);
        if (!is_used(first) || seen) continue;
        for (size_t j = i; j < file->n_shots; j++)
            n += is_used(&file->shots[j]) && is_together(&file->shots[j], first);
        if (n > most) best = first;
        if (n > most) most = n;
        ++*n_groups;
    }
    return best;
}

static cn_status make_camera(cn_importer *to, const cn_metashape_sensor *s, const char *who, cn_camera *camera)
{
    if (s->lens == CN_METASHAPE_OTHER)
        return cn_fail(CN_ERR_FORMAT, "%s: %s: its sensor is of type %s; supported are frame, fisheye and spherical",
                       to->path, who, s->type);
    if (!(s->width >= 1.0 && s->width < 1e6 && s->height >= 1.0 && s->height < 1e6) ||
        !(s->f > 0.0 || s->lens == CN_METASHAPE_SPHERICAL))
        return cn_fail(CN_ERR_FORMAT, "%s: %s: its sensor has no calibration with a size and f above 0", to->path, who);
    *camera = (cn_camera){ .width = (uint32_t)s->width, .height = (uint32_t)s->height };
    if (s->lens == CN_METASHAPE_SPHERICAL) return cn_importer_sphere(to, who, camera);
    const cn_import_lens lens = { .fisheye = s->lens == CN_METASHAPE_FISHEYE,
                                  .fx = s->f + s->b[0],
                                  .fy = s->f,
                                  .cx = 0.5 * s->width + s->c[0],
                                  .cy = 0.5 * s->height + s->c[1],
                                  .k = { s->k[0], s->k[1], s->k[2], s->k[3] },
                                  .p = { s->p[1], s->p[0] } };
    /* b2 shears the picture by so much at its upper and lower edges. */
    const double shear_px = fabs(s->b[1]) * 0.5 * s->height / s->f;
    if (!(shear_px <= 1e-3 * fmax(s->width, s->height)))
        return cn_fail(CN_ERR_FORMAT, "%s: %s: b2 shears the picture by %.1f px; align the photos again without b2",
                       to->path, who, shear_px);
    if (shear_px > to->worst_fit_px) to->worst_fit_px = shear_px;
    return cn_importer_lens(to, &lens, who, camera);
}

/* From the chunk to the world: world = scale * rotation * chunk + translation, then turned and moved to local axes. */
typedef struct placing {
    double scale, rotation[9], translation[3];
} placing;

/* Geocentric coordinates become east, north, up about the translation. */
static cn_status make_local(cn_importer *to, placing *p)
{
    bool by_egm96;
    double place[1][3], turned[9];
    const double far_m = cn_norm3(p->translation);
    if (!(far_m > EARTH_LEAST_M && far_m < EARTH_MOST_M)) return CN_OK;
    memcpy(place[0], p->translation, sizeof place[0]);
    CN_TRY(cn_crs_to_wgs84("EPSG:4978", CN_HEIGHTS_ELLIPSOID, 1, place, &by_egm96));
    to->origin = (cn_import_origin){
        .known = true, .latitude_deg = place[0][0], .longitude_deg = place[0][1], .height_m = place[0][2]
    };
    const double a = place[0][0] * CN_PI / 180.0, b = place[0][1] * CN_PI / 180.0;
    const double local[9] = { -sin(b),         cos(b),          0,     -sin(a) * cos(b), -sin(a) * sin(b), cos(a),
                              cos(a) * cos(b), cos(a) * sin(b), sin(a) };
    cn_mat3_mul(local, p->rotation, turned);
    memcpy(p->rotation, turned, sizeof turned);
    memset(p->translation, 0, sizeof p->translation);
    return CN_OK;
}

static cn_status find_placing(cn_importer *to, const cn_metashape *file, const cn_metashape_shot *of, placing *p)
{
    const cn_metashape_part *part = part_of(file, of->chunk, of->component);
    *p = (placing){ 1.0, { 1, 0, 0, 0, 1, 0, 0, 0, 1 }, { 0 } };
    if (!part) return CN_OK;
    p->scale = part->scale;
    memcpy(p->rotation, part->rotation, sizeof p->rotation);
    memcpy(p->translation, part->translation, sizeof p->translation);
    if (!(p->scale > 0.0 && isfinite(p->scale)) || !cn_import_rotation(p->rotation))
        return cn_fail(CN_ERR_FORMAT, "%s: a transform of its chunk has no rotation or no scale above 0", to->path);
    return make_local(to, p);
}

static cn_status add_shot(cn_importer *to, const cn_metashape *file, const cn_metashape_shot *shot, const placing *p)
{
    int64_t photo;
    double world[9], turned[9], centre[3], moved[3];
    cn_view view = { 0 };
    cn_camera camera;
    const cn_metashape_sensor *sensor = sensor_of(file, shot);
    cn_importer_find(to, shot->label, &photo);
    if (photo < 0) return CN_OK;
    if (!sensor)
        return cn_fail(CN_ERR_FORMAT, "%s: photo %s names sensor %ld, which does not exist", to->path, shot->label,
                       shot->sensor);
    for (int i = 0; i < 9; i++)
        turned[i] = shot->transform[4 * (i / 3) + i % 3];
    if (!cn_import_rotation(turned))
        return cn_fail(CN_ERR_FORMAT, "%s: the transform of photo %s is no rotation and translation", to->path,
                       shot->label);
    cn_mat3_mul(p->rotation, turned, world);
    const double at[3] = { shot->transform[3], shot->transform[7], shot->transform[11] };
    cn_mat3_vec(p->rotation, at, centre);
    for (int k = 0; k < 3; k++)
        centre[k] = p->scale * centre[k] + p->translation[k];
    cn_mat3_transpose(world, view.rotation);
    cn_mat3_vec(view.rotation, centre, moved);
    for (int k = 0; k < 3; k++)
        view.translation[k] = -moved[k];
    char *who = cn_format("photo %s", shot->label);
    const cn_status status = who ? make_camera(to, sensor, who, &camera) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(who);
    CN_TRY(status);
    return cn_importer_add(to, photo, &camera, &view);
}

static cn_status read_file(cn_importer *to, const cn_metashape *file)
{
    placing p;
    const cn_metashape_shot *first = largest(file, &to->n_models);
    if (!first)
        return cn_fail(CN_ERR_FORMAT, "%s: none of its %zu cameras is aligned and enabled; align the photos first",
                       to->path, file->n_shots);
    CN_TRY(find_placing(to, file, first, &p));
    CN_TRY(cn_importer_room(to, file->n_shots));
    for (size_t i = 0; i < file->n_shots; i++)
        if (is_used(&file->shots[i]) && is_together(&file->shots[i], first))
            CN_TRY(add_shot(to, file, &file->shots[i], &p));
    return CN_OK;
}

cn_status cn_import_metashape(cn_importer *to)
{
    cn_metashape file;
    CN_TRY(cn_metashape_read(to->path, &file));
    const cn_status status = read_file(to, &file);
    cn_metashape_deinit(&file);
    return status;
}
