/* plan.json. */
#include "plan/plan.h"

#include "base/file.h"

#include <math.h>
#include <stdlib.h>

#define MAX_NAMES 100000u /* in all lists together; beyond, plan.json holds runs of indices */

/* Writes names, or runs of indices in large plans. */
static json_t *photo_list(const cn_scene *scene, const uint32_t *views, uint32_t n, bool runs)
{
    if (runs) {
        char *text = cn_plan_runs_write(views, n);
        json_t *value = text ? json_string_nocheck(text) : NULL;
        free(text);
        return value;
    }
    json_t *list = json_array();
    for (uint32_t i = 0; i < n; i++)
        json_array_append_new(list, json_string(scene->views[views[i]].name));
    return list;
}

static json_t *effects_to_json(const cn_plan_tile *tile)
{
    json_t *effects = json_object();
    for (uint32_t i = 0; i < tile->n_effects; i++) {
        const cn_plan_effect *e = &tile->effects[i];
        json_t *item = json_object();
        json_object_set_new(item, "on", json_boolean(e->on));
        json_object_set_new(item, "evidence", cn_json_real(e->evidence));
        json_object_set_new(item, "threshold", cn_json_real(e->threshold));
        json_object_set_new(item, "reason", json_string(e->reason));
        json_object_set_new(item, "cost_seconds", cn_json_real(e->cost_s));
        json_object_set_new(item, "cost_bytes", json_integer(e->cost_bytes));
        json_object_set_new(effects, e->name, item);
    }
    return effects;
}

static json_t *tile_to_json(const cn_plan_tile *tile, const cn_scene *scene, bool runs)
{
    json_t *item = json_object(), *estimate = json_object();
    json_object_set_new(item, "id", json_string(tile->id));
    json_object_set_new(item, "centre", cn_json_reals(tile->centre, 3));
    json_object_set_new(item, "radius_m", cn_json_real(tile->radius_m));
    json_object_set_new(item, "bounds_min", cn_json_reals(tile->bounds_min, 3));
    json_object_set_new(item, "bounds_max", cn_json_reals(tile->bounds_max, 3));
    json_object_set_new(item, "near_m", cn_json_real(tile->near_m));
    json_object_set_new(item, "far_m", cn_json_real(tile->far_m));
    json_object_set_new(item, "photos", photo_list(scene, tile->photos, tile->n_photos, runs));
    json_object_set_new(item, "held_out", photo_list(scene, tile->held_out, tile->n_held_out, runs));
    json_object_set_new(item, "effects", effects_to_json(tile));
    json_object_set_new(estimate, "seconds", cn_json_real(tile->estimate_s));
    json_object_set_new(estimate, "bytes", json_integer((json_int_t)tile->estimate_bytes));
    json_object_set_new(item, "estimate", estimate);
    return item;
}

static uint64_t count_names(const cn_plan *plan)
{
    uint64_t n = 0;
    for (uint32_t i = 0; i < plan->n_tiles; i++)
        n += plan->tiles[i].n_photos + plan->tiles[i].n_held_out;
    return n;
}

static json_t *views_to_json(const cn_scene *scene)
{
    char hex[17];
    cn_plan_views_hash(scene, hex);
    return json_pack("{s:I,s:s}", "count", (json_int_t)scene->n_views, "hash", hex);
}

static cn_status write_json(const cn_plan *plan, const cn_scene *scene, const char *path)
{
    json_t *root = json_object(), *tiles = json_array(), *warnings = json_array();
    const bool runs = count_names(plan) > MAX_NAMES;
    for (uint32_t i = 0; i < plan->n_warnings; i++)
        json_array_append_new(warnings, json_string(plan->warnings[i]));
    for (uint32_t i = 0; i < plan->n_tiles; i++)
        json_array_append_new(tiles, tile_to_json(&plan->tiles[i], scene, runs));
    json_object_set_new(root, "version", json_integer(runs ? CN_PLAN_VERSION : 1));
    if (runs) json_object_set_new(root, "views", views_to_json(scene));
    json_object_set_new(root, "layout", json_string(cn_layout_name(plan->layout)));
    json_object_set_new(root, "overlap", cn_json_real(plan->overlap));
    json_object_set_new(root, "warnings", warnings);
    json_object_set_new(root, "tiles", tiles);
    /* jansson accepts the NULL of a failed allocation, so one test at the end is enough. */
    bool whole = json_array_size(tiles) == plan->n_tiles && json_object_size(root) == 5u + runs;
    cn_status status = whole ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "out of memory writing %s", path);
    json_decref(root);
    return status;
}

static cn_status write_in(const char *dir, const char *name, const cn_plan *plan, const cn_plan_input *input,
                          cn_status (*write)(const cn_plan *, const cn_plan_input *, const char *))
{
    char *path = cn_path_join(dir, name);
    cn_status status =
        path ? write(plan, input, path) : cn_fail(CN_ERR_NOMEM, "out of memory writing %s/%s", dir, name);
    free(path);
    return status;
}

static cn_status write_plan(const cn_plan *plan, const cn_plan_input *input, const char *path)
{
    return write_json(plan, input->scene, path);
}

cn_status cn_plan_save(const cn_plan *plan, const cn_plan_input *input, const char *dir)
{
    CN_TRY(cn_folder_make(dir));
    CN_TRY(write_in(dir, "tiles.geojson", plan, input, cn_plan_write_geojson));
    CN_TRY(write_in(dir, "plan.svg", plan, input, cn_plan_write_svg));
    return write_in(dir, "plan.json", plan, input, write_plan);
}
