/* Places of photos in a plane, and groups.json. */
#include "base/file.h"
#include "base/json.h"
#include "conurb/geo.h"
#include "pose/groups.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ONE_PLACE_M 0.1
enum { VERSION = 1 };

static cn_status place_all(const cn_photo_index *index, double (*places)[2], bool *apart)
{
    cn_frame frame;
    double low[2] = { 0 }, high[2] = { 0 };
    uint32_t last = UINT32_MAX;
    cn_frame_init(&frame);
    for (uint32_t i = 0; i < index->n_photos; i++) {
        const cn_photo *photo = &index->photos[i];
        const double at[3] = { photo->latitude_deg, photo->longitude_deg, 0.0 };
        double local[3];
        if (!photo->has_gps) continue;
        if (!frame.georeferenced) {
            frame.georeferenced = true;
            frame.latitude_deg = at[0];
            frame.longitude_deg = at[1];
        }
        CN_TRY(cn_frame_from_geodetic(&frame, at, local));
        for (int k = 0; k < 2; k++) {
            places[i][k] = local[k];
            if (local[k] < low[k]) low[k] = local[k];
            if (local[k] > high[k]) high[k] = local[k];
        }
        /* Photos without GPS: half of those between two with GPS go to each. */
        for (uint32_t j = last == UINT32_MAX ? 0 : (last + i) / 2 + 1; j < i; j++)
            memcpy(places[j], places[i], sizeof places[j]);
        for (uint32_t j = last == UINT32_MAX ? i : last + 1; j < i && j <= (last + i) / 2; j++)
            memcpy(places[j], places[last], sizeof places[j]);
        last = i;
    }
    for (uint32_t j = last + 1; last != UINT32_MAX && j < index->n_photos; j++)
        memcpy(places[j], places[last], sizeof places[j]);
    *apart = high[0] - low[0] > ONE_PLACE_M || high[1] - low[1] > ONE_PLACE_M;
    return CN_OK;
}

cn_status cn_photo_places(const cn_photo_index *index, double (**places)[2])
{
    *places = NULL;
    if (2 * (uint64_t)index->n_gps <= index->n_photos) return CN_OK;
    double(*found)[2] = calloc(index->n_photos + (size_t)1, sizeof *found);
    bool apart = false;
    if (!found) return cn_fail(CN_ERR_NOMEM, "out of memory placing %u photos", index->n_photos);
    const cn_status status = place_all(index, found, &apart);
    if (status == CN_OK && apart)
        *places = found;
    else
        free(found);
    return status;
}

cn_status cn_photo_groups_save(const cn_photo_groups *groups, const char *key, const char *by, const char *path)
{
    json_t *list = json_array();
    for (uint32_t i = 0; i < groups->n; i++) {
        const cn_photo_group *g = &groups->groups[i];
        json_t *core = json_array(), *shared = json_array();
        for (uint32_t k = 0; k < g->n; k++)
            json_array_append_new(k < g->n_core ? core : shared, json_integer(g->photos[k]));
        json_array_append_new(list, json_pack("{s:o, s:o}", "core", core, "shared", shared));
    }
    json_t *root = json_pack("{s:i, s:s, s:s, s:o}", "version", VERSION, "key", key, "by", by, "groups", list);
    const cn_status status = root ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    json_decref(root);
    return status;
}

static cn_status add_photos(const json_t *list, const char *path, uint32_t n_photos, cn_photo_group *group)
{
    for (size_t k = 0; k < json_array_size(list); k++) {
        const json_t *item = json_array_get(list, k);
        const json_int_t photo = json_integer_value(item);
        if (!json_is_integer(item) || photo < 0 || photo >= n_photos)
            return cn_fail(CN_ERR_FORMAT, "%s names a photo that is not there; remove it and run again", path);
        group->photos[group->n++] = (uint32_t)photo;
    }
    return CN_OK;
}

static cn_status read_group(const json_t *from, const char *path, uint32_t n_photos, cn_photo_group *group)
{
    const json_t *core, *shared;
    CN_TRY(cn_json_array(from, path, "core", &core));
    CN_TRY(cn_json_array(from, path, "shared", &shared));
    group->photos = malloc((json_array_size(core) + json_array_size(shared) + 1) * sizeof *group->photos);
    if (!group->photos) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    CN_TRY(add_photos(core, path, n_photos, group));
    group->n_core = group->n;
    return add_photos(shared, path, n_photos, group);
}

static cn_status read_groups(const json_t *root, const char *path, uint32_t n_photos, cn_photo_groups *out)
{
    const json_t *list;
    CN_TRY(cn_json_array(root, path, "groups", &list));
    out->groups = calloc(json_array_size(list) + 1, sizeof *out->groups);
    if (!out->groups) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    out->n = (uint32_t)json_array_size(list);
    for (uint32_t i = 0; i < out->n; i++)
        CN_TRY(read_group(json_array_get(list, i), path, n_photos, &out->groups[i]));
    return CN_OK;
}

static cn_status check_head(const json_t *root, const char *path, const char *key)
{
    int64_t version;
    const char *theirs;
    CN_TRY(cn_json_integer(root, path, "version", &version));
    if (version > VERSION)
        return cn_fail(CN_ERR_VERSION, "%s was made by a newer Conurb; update Conurb, or remove the file", path);
    CN_TRY(cn_json_string(root, path, "key", &theirs));
    if (!key || strcmp(theirs, key) == 0) return CN_OK;
    return cn_fail(CN_ERR_DATA, "%s is of other photos or settings; run conurb poses again", path);
}

cn_status cn_photo_groups_load(cn_photo_groups *groups, const char *key, uint32_t n_photos, const char *path)
{
    json_t *root = NULL;
    *groups = (cn_photo_groups){ 0 };
    if (!cn_file_exists(path)) return cn_fail(CN_ERR_DATA, "%s is not there; run conurb poses first", path);
    CN_TRY(cn_json_load(path, &root));
    cn_status status = check_head(root, path, key);
    if (status == CN_OK) status = read_groups(root, path, n_photos, groups);
    json_decref(root);
    if (status != CN_OK) cn_photo_groups_deinit(groups);
    return status;
}
