/* photos.json. */
#include "photo/index_file.h"

#include "base/hash.h"
#include "base/json.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { FORMAT = 1 };

static json_t *photo_json(const cn_photo *p)
{
    char hash[24];
    snprintf(hash, sizeof hash, "%016" PRIx64, p->hash);
    json_t *o = json_pack("{s:s,s:i,s:i,s:i,s:s,s:s}", "name", p->name, "width", (int)p->width, "height",
                          (int)p->height, "orientation", (int)p->orientation, "camera", p->camera, "hash", hash);
    if (!o) return NULL;
    if (p->has_gps) {
        json_object_set_new(o, "latitude_deg", json_real(p->latitude_deg));
        json_object_set_new(o, "longitude_deg", json_real(p->longitude_deg));
    }
    if (p->has_altitude) json_object_set_new(o, "altitude_m", json_real(p->altitude_m));
    if (p->gps_sigma_m[0] > 0) json_object_set_new(o, "gps_sigma_m", cn_json_reals(p->gps_sigma_m, 3));
    json_object_set_new(o, "time_s", cn_json_real(p->time_s));
    json_object_set_new(o, "exposure_s", cn_json_real(p->exposure_s));
    json_object_set_new(o, "iso", cn_json_real(p->iso));
    json_object_set_new(o, "f_number", cn_json_real(p->f_number));
    json_object_set_new(o, "focal_mm", cn_json_real(p->focal_mm));
    json_object_set_new(o, "focal_35mm", cn_json_real(p->focal_35mm));
    if (p->deep) json_object_set_new(o, "deep", json_true());
    if (p->equirectangular) json_object_set_new(o, "equirectangular", json_true());
    if (p->mask) json_object_set_new(o, "mask", json_string(p->mask));
    return o;
}

cn_status cn_photo_index_save(const cn_photo_index *index, const char *path)
{
    json_t *photos = json_array(), *rejects = json_array();
    bool good = photos && rejects;
    for (uint32_t i = 0; good && i < index->n_photos; i++)
        good = json_array_append_new(photos, photo_json(&index->photos[i])) == 0;
    for (uint32_t i = 0; good && i < index->n_rejects; i++) {
        const cn_photo_reject *r = &index->rejects[i];
        good = json_array_append_new(rejects, json_pack("{s:s,s:s}", "name", r->name, "reason", r->reason)) == 0;
    }
    json_t *root = json_pack("{s:i,s:s,s:O,s:O}", "version", FORMAT, "folder", index->folder, "photos", photos,
                             "left_out", rejects);
    json_decref(photos);
    json_decref(rejects);
    cn_status status = CN_OK;
    if (!good || !root)
        status = cn_fail(CN_ERR_DATA,
                         "%s cannot be written: a file or folder name is not UTF-8, or memory ran out; "
                         "rename what is below %s",
                         path, index->folder);
    if (status == CN_OK) status = cn_json_save(root, path);
    json_decref(root);
    return status;
}

cn_status cn_photo_index_hash(const char *path, uint64_t *hash)
{
    json_t *root = NULL;
    CN_TRY(cn_json_load(path, &root));
    char *text = json_dumps(json_object_get(root, "photos"), JSON_COMPACT | JSON_SORT_KEYS | JSON_ENCODE_ANY);
    json_decref(root);
    if (!text)
        return cn_fail(CN_ERR_FORMAT, "%s: \"photos\" is missing; delete the file and run `conurb poses` again", path);
    *hash = cn_hash64(text, strlen(text));
    free(text);
    return CN_OK;
}

static cn_status read_ranged(const json_t *o, const char *path, const char *key, int64_t most, int64_t *n)
{
    CN_TRY(cn_json_integer(o, path, key, n));
    if (*n < 1 || *n > most)
        return cn_fail(CN_ERR_FORMAT, "%s: %s is %lld, not in 1 to %lld; delete the file and run `conurb poses` again",
                       path, key, (long long)*n, (long long)most);
    return CN_OK;
}

static cn_status read_photo(const json_t *o, const char *path, cn_photo *p)
{
    const char *text;
    int64_t n;
    CN_TRY(cn_json_string(o, path, "name", &text));
    p->name = strdup(text);
    CN_TRY(cn_json_string(o, path, "camera", &text));
    p->camera = strdup(text);
    CN_TRY(cn_json_string(o, path, "hash", &text));
    p->hash = strtoull(text, NULL, 16);
    CN_TRY(read_ranged(o, path, "width", 65535, &n));
    p->width = (uint32_t)n;
    CN_TRY(read_ranged(o, path, "height", 65535, &n));
    p->height = (uint32_t)n;
    CN_TRY(read_ranged(o, path, "orientation", 8, &n));
    p->orientation = (uint8_t)n;
    CN_TRY(cn_json_number_or(o, path, "latitude_deg", NAN, &p->latitude_deg));
    CN_TRY(cn_json_number_or(o, path, "longitude_deg", NAN, &p->longitude_deg));
    p->has_gps = fabs(p->latitude_deg) <= 90 && fabs(p->longitude_deg) <= 180;
    CN_TRY(cn_json_number_or(o, path, "altitude_m", NAN, &p->altitude_m));
    p->has_altitude = isfinite(p->altitude_m);
    if (json_object_get(o, "gps_sigma_m")) CN_TRY(cn_json_numbers(o, path, "gps_sigma_m", p->gps_sigma_m, 3));
    CN_TRY(cn_json_number_or(o, path, "time_s", NAN, &p->time_s));
    CN_TRY(cn_json_number_or(o, path, "exposure_s", NAN, &p->exposure_s));
    CN_TRY(cn_json_number_or(o, path, "iso", NAN, &p->iso));
    CN_TRY(cn_json_number_or(o, path, "f_number", NAN, &p->f_number));
    CN_TRY(cn_json_number_or(o, path, "focal_mm", NAN, &p->focal_mm));
    CN_TRY(cn_json_number_or(o, path, "focal_35mm", NAN, &p->focal_35mm));
    p->deep = json_is_true(json_object_get(o, "deep"));
    p->equirectangular = json_is_true(json_object_get(o, "equirectangular"));
    const char *mask = json_string_value(json_object_get(o, "mask"));
    p->mask = mask ? strdup(mask) : NULL;
    if (!p->name || !p->camera || (mask && !p->mask))
        return cn_fail(CN_ERR_NOMEM, "out of memory while reading %s", path);
    return CN_OK;
}

static cn_status read_index(const json_t *root, const char *path, cn_photo_index *index)
{
    int64_t version;
    const json_t *photos, *rejects;
    const char *folder;
    CN_TRY(cn_json_integer(root, path, "version", &version));
    if (version > FORMAT) return cn_fail(CN_ERR_VERSION, "%s was made by a newer Conurb; update Conurb", path);
    CN_TRY(cn_json_string(root, path, "folder", &folder));
    CN_TRY(cn_json_array(root, path, "photos", &photos));
    CN_TRY(cn_json_array(root, path, "left_out", &rejects));
    index->folder = strdup(folder);
    index->photos = calloc(json_array_size(photos) + 1, sizeof *index->photos);
    index->rejects = calloc(json_array_size(rejects) + 1, sizeof *index->rejects);
    if (!index->folder || !index->photos || !index->rejects)
        return cn_fail(CN_ERR_NOMEM, "out of memory while reading %s", path);
    for (size_t i = 0; i < json_array_size(photos); i++) {
        index->n_photos++;
        CN_TRY(read_photo(json_array_get(photos, i), path, &index->photos[i]));
        index->n_gps += index->photos[i].has_gps;
    }
    for (size_t i = 0; i < json_array_size(rejects); i++) {
        const char *name, *reason;
        CN_TRY(cn_json_string(json_array_get(rejects, i), path, "name", &name));
        CN_TRY(cn_json_string(json_array_get(rejects, i), path, "reason", &reason));
        cn_photo_reject *r = &index->rejects[index->n_rejects++];
        *r = (cn_photo_reject){ strdup(name), strdup(reason) };
        if (!r->name || !r->reason) return cn_fail(CN_ERR_NOMEM, "out of memory while reading %s", path);
    }
    return CN_OK;
}

cn_status cn_photo_index_load(cn_photo_index *index, const char *path)
{
    *index = (cn_photo_index){ 0 };
    json_t *root = NULL;
    CN_TRY(cn_json_load(path, &root));
    const cn_status status = read_index(root, path, index);
    json_decref(root);
    if (status != CN_OK) cn_photo_index_deinit(index);
    return status;
}
