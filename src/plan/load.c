/* Reads plan.json back. The file may have been edited or damaged, so every value is checked. */
#include "plan/plan.h"

#include "base/file.h"
#include "pose/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_TILES 1000000u
#define AGAIN "run `conurb plan` again"

static bool id_is_safe(const char *id)
{
    size_t n = strspn(id, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+-_");
    return n > 0 && id[n] == '\0' && n < CN_TILE_ID_SIZE && id[0] != '-';
}

static int compare_indices(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

static cn_status read_names(const json_t *item, const char *where, const char *key, const cn_scene *scene,
                            uint32_t **views, uint32_t *n)
{
    const json_t *list = json_object_get(item, key);
    if (json_is_string(list)) return cn_plan_runs_read(json_string_value(list), scene->n_views, where, views, n);
    CN_TRY(cn_json_array(item, where, key, &list));
    size_t count = json_array_size(list);
    if (count > scene->n_views)
        return cn_fail(CN_ERR_FORMAT, "%s: \"%s\" holds %zu photos, but only %u have a pose; " AGAIN, where, key, count,
                       scene->n_views);
    *views = malloc(sizeof **views * (count + 1));
    if (!*views) return cn_fail(CN_ERR_NOMEM, "out of memory for %zu photos of %s", count, where);
    for (size_t i = 0; i < count; i++) {
        const char *name = json_string_value(json_array_get(list, i));
        if (!name) return cn_fail(CN_ERR_FORMAT, "%s: \"%s\", item %zu is not a name; " AGAIN, where, key, i);
        int64_t view = cn_scene_find_view(scene, name);
        if (view < 0) return cn_fail(CN_ERR_DATA, "%s: photo %.200s no longer has a pose; " AGAIN, where, name);
        (*views)[i] = (uint32_t)view;
    }
    qsort(*views, count, sizeof **views, compare_indices);
    for (size_t i = 1; i < count; i++)
        if ((*views)[i] == (*views)[i - 1])
            return cn_fail(CN_ERR_FORMAT, "%s: \"%s\" names %.200s twice; " AGAIN, where, key,
                           scene->views[(*views)[i]].name);
    *n = (uint32_t)count;
    return CN_OK;
}

/* Both ascending. */
static cn_status check_apart(const cn_plan_tile *tile, const char *where, const cn_scene *scene)
{
    for (uint32_t i = 0, j = 0; i < tile->n_photos && j < tile->n_held_out;) {
        if (tile->photos[i] == tile->held_out[j])
            return cn_fail(CN_ERR_FORMAT, "%s: %.200s is both trained on and held out; " AGAIN, where,
                           scene->views[tile->photos[i]].name);
        if (tile->photos[i] < tile->held_out[j])
            i++;
        else
            j++;
    }
    return CN_OK;
}

static cn_status read_effects(cn_plan_tile *tile, const json_t *item, const char *where)
{
    const json_t *effects = json_object_get(item, "effects");
    const char *name, *reason;
    json_t *value;
    if (!json_is_object(effects) || json_object_size(effects) > CN_MAX_EFFECTS)
        return cn_fail(CN_ERR_FORMAT, "%s: \"effects\" must be an object of at most %d; " AGAIN, where, CN_MAX_EFFECTS);
    json_object_foreach((json_t *)effects, name, value)
    {
        cn_plan_effect *e = &tile->effects[tile->n_effects++];
        if (strlen(name) >= sizeof e->name)
            return cn_fail(CN_ERR_FORMAT, "%s: unknown effect %.40s; " AGAIN, where, name);
        snprintf(e->name, sizeof e->name, "%s", name);
        CN_TRY(cn_json_bool(value, where, "on", &e->on));
        CN_TRY(cn_json_number_or(value, where, "evidence", NAN, &e->evidence));
        CN_TRY(cn_json_number_or(value, where, "threshold", NAN, &e->threshold));
        CN_TRY(cn_json_string(value, where, "reason", &reason));
        snprintf(e->reason, sizeof e->reason, "%s", reason);
        CN_TRY(cn_json_number_or(value, where, "cost_seconds", NAN, &e->cost_s));
        CN_TRY(cn_json_integer(value, where, "cost_bytes", &e->cost_bytes));
    }
    return CN_OK;
}

static cn_status read_sizes(cn_plan_tile *tile, const json_t *item, const char *where)
{
    int64_t bytes;
    CN_TRY(cn_json_numbers(item, where, "centre", tile->centre, 3));
    CN_TRY(cn_json_number(item, where, "radius_m", &tile->radius_m));
    CN_TRY(cn_json_numbers(item, where, "bounds_min", tile->bounds_min, 3));
    CN_TRY(cn_json_numbers(item, where, "bounds_max", tile->bounds_max, 3));
    CN_TRY(cn_json_number(item, where, "near_m", &tile->near_m));
    CN_TRY(cn_json_number(item, where, "far_m", &tile->far_m));
    bool good = tile->radius_m > 0 && tile->near_m > 0 && tile->far_m > tile->near_m;
    for (int k = 0; k < 3; k++)
        good = good && tile->bounds_max[k] > tile->bounds_min[k];
    if (!good) return cn_fail(CN_ERR_FORMAT, "%s: radius, bounds, near or far is invalid; " AGAIN, where);
    const json_t *estimate = json_object_get(item, "estimate");
    CN_TRY(cn_json_number_or(estimate, where, "seconds", NAN, &tile->estimate_s));
    CN_TRY(cn_json_integer(estimate, where, "bytes", &bytes));
    if (bytes < 0) return cn_fail(CN_ERR_FORMAT, "%s: \"bytes\" is negative; " AGAIN, where);
    tile->estimate_bytes = (uint64_t)bytes;
    return CN_OK;
}

static cn_status read_tile(cn_plan_tile *tile, const json_t *item, const char *where, const cn_scene *scene)
{
    const char *id;
    CN_TRY(cn_json_string(item, where, "id", &id));
    if (!id_is_safe(id)) return cn_fail(CN_ERR_FORMAT, "%s: \"%.40s\" cannot be the id of a tile; " AGAIN, where, id);
    snprintf(tile->id, sizeof tile->id, "%s", id);
    CN_TRY(read_sizes(tile, item, where));
    CN_TRY(read_names(item, where, "photos", scene, &tile->photos, &tile->n_photos));
    CN_TRY(read_names(item, where, "held_out", scene, &tile->held_out, &tile->n_held_out));
    if (tile->n_photos == 0) return cn_fail(CN_ERR_FORMAT, "%s: has no photos; " AGAIN, where);
    CN_TRY(check_apart(tile, where, scene));
    return read_effects(tile, item, where);
}

/* Indices are valid only for the same list of views. */
static cn_status check_views(const json_t *root, const char *path, int64_t version, const cn_scene *scene)
{
    const json_t *views = json_object_get(root, "views");
    const char *hash;
    char hex[17];
    if (version < 2) return CN_OK; /* names */
    CN_TRY(cn_json_string(views, path, "hash", &hash));
    cn_plan_views_hash(scene, hex);
    if (strcmp(hash, hex) != 0)
        return cn_fail(CN_ERR_DATA, "%s was made for other poses than the present ones; " AGAIN, path);
    return CN_OK;
}

static cn_status read_tiles(cn_plan *plan, const json_t *root, const char *path, const cn_scene *scene)
{
    const json_t *tiles;
    CN_TRY(cn_json_array(root, path, "tiles", &tiles));
    size_t n = json_array_size(tiles);
    if (n == 0 || n > MAX_TILES) return cn_fail(CN_ERR_FORMAT, "%s: holds %zu tiles; " AGAIN, path, n);
    plan->tiles = calloc(n, sizeof *plan->tiles);
    if (!plan->tiles) return cn_fail(CN_ERR_NOMEM, "out of memory for the %zu tiles of %s", n, path);
    plan->n_tiles = (uint32_t)n;
    for (uint32_t i = 0; i < n; i++) {
        char where[512];
        snprintf(where, sizeof where, "%s: tile %u", path, i);
        CN_TRY(read_tile(&plan->tiles[i], json_array_get(tiles, i), where, scene));
        if (i > 0 && strcmp(plan->tiles[i - 1].id, plan->tiles[i].id) >= 0)
            return cn_fail(CN_ERR_FORMAT, "%s: tiles are duplicated or out of order; " AGAIN, where);
    }
    return CN_OK;
}

static cn_status read_warnings(cn_plan *plan, const json_t *root, const char *path)
{
    const json_t *warnings;
    CN_TRY(cn_json_array(root, path, "warnings", &warnings));
    for (size_t i = 0; i < json_array_size(warnings); i++) {
        const char *text = json_string_value(json_array_get(warnings, i));
        if (text) CN_TRY(cn_plan_warn(&(cn_context){ 0 }, plan, "%s", text));
    }
    return CN_OK;
}

static cn_status read_plan(cn_plan *plan, const json_t *root, const char *path, const cn_scene *scene)
{
    int64_t version;
    const char *layout;
    CN_TRY(cn_json_integer(root, path, "version", &version));
    if (version > CN_PLAN_VERSION)
        return cn_fail(CN_ERR_VERSION, "%s: format version %lld is newer than this Conurb's %d; update Conurb", path,
                       (long long)version, CN_PLAN_VERSION);
    if (version < 1) return cn_fail(CN_ERR_FORMAT, "%s: there is no version %lld; " AGAIN, path, (long long)version);
    CN_TRY(cn_json_string(root, path, "layout", &layout));
    int known = CN_LAYOUT_CENTRES;
    while (known >= 0 && strcmp(cn_layout_name((cn_layout)known), layout) != 0)
        known--;
    if (known < 0) return cn_fail(CN_ERR_FORMAT, "%s: unknown layout \"%.40s\"; " AGAIN, path, layout);
    plan->layout = (cn_layout)known;
    CN_TRY(cn_json_number(root, path, "overlap", &plan->overlap));
    CN_TRY(read_warnings(plan, root, path));
    CN_TRY(check_views(root, path, version, scene));
    return read_tiles(plan, root, path, scene);
}

cn_status cn_plan_load(cn_plan *plan, const cn_scene *scene, const char *dir)
{
    json_t *root = NULL;
    *plan = (cn_plan){ 0 };
    char *path = cn_path_join(dir, "plan.json");
    if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory reading %s/plan.json", dir);
    cn_status status = cn_json_load(path, &root);
    if (status == CN_OK) status = read_plan(plan, root, path, scene);
    json_decref(root);
    free(path);
    if (status != CN_OK) cn_plan_deinit(plan);
    return status;
}
