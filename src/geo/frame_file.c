/* frame.json */
#include "base/file.h"
#include "base/json.h"
#include "conurb/geo.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define FRAME_VERSION 1

cn_status cn_frame_save(const cn_frame *frame, const char *path)
{
    json_t *root = json_pack(
        "{s:s, s:i, s:b, s:s, s:{s:o, s:o, s:o}, s:{s:s, s:b, s:o}, s:{s:o, s:o, s:o}, s:{s:o, s:o}, "
        "s:{s:I, s:I}, s:b}",
        "format", "conurb-frame", "version", FRAME_VERSION, "georeferenced", (int)frame->georeferenced, "axes",
        frame->georeferenced ? "x east, y north, z up; metres from origin" : "of the poses' source; no true metres",
        "origin", "latitude_deg", cn_json_real(frame->latitude_deg), "longitude_deg",
        cn_json_real(frame->longitude_deg), "height_m", cn_json_real(frame->height_m), "geoid", "name", "EGM96",
        "applied", (int)frame->geoid_applied, "height_m", cn_json_real(frame->geoid_height_m), "local_from_source",
        "scale", cn_json_real(frame->scale), "rotation", cn_json_reals(frame->rotation, 9), "translation",
        cn_json_reals(frame->translation, 3), "residual", "horizontal_m", cn_json_real(frame->residual_horizontal_m),
        "vertical_m", cn_json_real(frame->residual_vertical_m), "gps", "photos", (json_int_t)frame->n_gps, "inliers",
        (json_int_t)frame->n_inliers, "nadir_ambiguous", (int)frame->nadir_ambiguous);
    if (!root) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    cn_status status = cn_json_save(root, path);
    json_decref(root);
    return status;
}

cn_status cn_frame_save_beside(const cn_frame *frame, const char *path)
{
    static const char *const endings[] = { ".ply", ".obj", ".glb", ".las", ".spz", ".chan", NULL };
    const char *dot = strrchr(cn_path_base(path), '.');
    size_t stem = strlen(path);
    for (int i = 0; dot && endings[i]; i++)
        if (strcmp(dot, endings[i]) == 0) stem = (size_t)(dot - path);
    char *beside = cn_format("%.*s.frame.json", (int)stem, path);
    const cn_status status =
        beside ? cn_frame_save(frame, beside) : cn_fail(CN_ERR_NOMEM, "out of memory for %s", path);
    free(beside);
    return status;
}

static cn_status check_version(const json_t *root, const char *path)
{
    int64_t version;
    CN_TRY(cn_json_integer(root, path, "version", &version));
    if (version > FRAME_VERSION)
        return cn_fail(CN_ERR_VERSION,
                       "%s: version %lld was made by a newer Conurb (this one reads up to %d); update "
                       "Conurb or run conurb poses again",
                       path, (long long)version, FRAME_VERSION);
    return CN_OK;
}

static cn_status read_count(const json_t *object, const char *path, const char *key, uint32_t *count)
{
    int64_t value;
    CN_TRY(cn_json_integer(object, path, key, &value));
    if (value < 0 || value > UINT32_MAX)
        return cn_fail(CN_ERR_FORMAT, "%s: gps.%s is %lld; run conurb poses again", path, key, (long long)value);
    *count = (uint32_t)value;
    return CN_OK;
}

static cn_status read_similarity(const json_t *root, const char *path, cn_frame *frame)
{
    const json_t *similarity = json_object_get(root, "local_from_source");
    CN_TRY(cn_json_number(similarity, path, "scale", &frame->scale));
    CN_TRY(cn_json_numbers(similarity, path, "rotation", frame->rotation, 9));
    CN_TRY(cn_json_numbers(similarity, path, "translation", frame->translation, 3));
    if (!(frame->scale > 0.0) || !isfinite(frame->scale))
        return cn_fail(CN_ERR_FORMAT, "%s: local_from_source.scale is %g; run conurb poses again", path, frame->scale);
    return CN_OK;
}

static cn_status read_frame(const json_t *root, const char *path, cn_frame *frame)
{
    CN_TRY(check_version(root, path));
    const json_t *origin = json_object_get(root, "origin"), *geoid = json_object_get(root, "geoid");
    const json_t *residual = json_object_get(root, "residual"), *gps = json_object_get(root, "gps");
    CN_TRY(cn_json_bool(root, path, "georeferenced", &frame->georeferenced));
    CN_TRY(cn_json_bool(root, path, "nadir_ambiguous", &frame->nadir_ambiguous));
    CN_TRY(cn_json_number(origin, path, "latitude_deg", &frame->latitude_deg));
    CN_TRY(cn_json_number(origin, path, "longitude_deg", &frame->longitude_deg));
    CN_TRY(cn_json_number(origin, path, "height_m", &frame->height_m));
    CN_TRY(cn_json_bool(geoid, path, "applied", &frame->geoid_applied));
    CN_TRY(cn_json_number(geoid, path, "height_m", &frame->geoid_height_m));
    CN_TRY(read_similarity(root, path, frame));
    CN_TRY(cn_json_number(residual, path, "horizontal_m", &frame->residual_horizontal_m));
    CN_TRY(cn_json_number(residual, path, "vertical_m", &frame->residual_vertical_m));
    CN_TRY(read_count(gps, path, "photos", &frame->n_gps));
    CN_TRY(read_count(gps, path, "inliers", &frame->n_inliers));
    if (!(fabs(frame->latitude_deg) <= 90.0))
        return cn_fail(CN_ERR_FORMAT, "%s: origin.latitude_deg is %g; run conurb poses again", path,
                       frame->latitude_deg);
    return CN_OK;
}

cn_status cn_frame_load(cn_frame *frame, const char *path)
{
    json_t *root = NULL;
    cn_frame_init(frame);
    CN_TRY(cn_json_load(path, &root));
    cn_status status = read_frame(root, path, frame);
    json_decref(root);
    if (status != CN_OK) cn_frame_init(frame);
    return status;
}
