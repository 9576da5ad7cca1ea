/* What each stage depends on. */
#include "record/record.h"

#include "base/file.h"
#include "base/hash.h"
#include "base/json.h"
#include "conurb/colour.h"
#include "effect/effect.h"
#include "photo/index_file.h"
#include "pose/import.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void add_hash(cn_fingerprint *fingerprint, const char *name, uint64_t hash)
{
    cn_fingerprint_add(fingerprint, name, "%016" PRIx64, hash);
}

/* Hash of the files that the poses are read from. A file that cannot be read is reported later, by the import. */
static cn_status hash_import(const char *import, uint64_t *hash)
{
    const size_t length = strlen(import);
    cn_import_files files;
    *hash = 0;
    const cn_status found = cn_import_list(import, &files);
    if (found != CN_OK) return found == CN_ERR_NOMEM ? found : CN_OK;
    for (uint32_t i = 0; i < files.n; i++) {
        const char *path = files.paths[i];
        const bool below = strncmp(path, import, length) == 0 && path[length] == '/';
        uint64_t one;
        if (!cn_file_exists(path) || cn_hash_file(path, &one) != CN_OK) continue;
        if (strcmp(path, import) == 0)
            *hash = one;
        else if (below)
            *hash = cn_hash_text(*hash, "%s %016" PRIx64, path + length + 1, one);
        else
            *hash = cn_hash_text(*hash, "%016" PRIx64, one);
    }
    cn_import_files_deinit(&files);
    return CN_OK;
}

/* Nothing where there is no file of control points, so that older records stay as they are. A file that cannot be read
 * is reported later. */
static cn_status add_control(const cn_config *c, cn_stage *stage)
{
    uint64_t hash = 0;
    if (cn_file_exists(c->control)) CN_TRY(cn_hash_file(c->control, &hash));
    cn_fingerprint_add(&stage->config, "poses.control", "%s", c->control);
    cn_fingerprint_add(&stage->config, "poses.check", "%s", c->check ? c->check : "");
    cn_fingerprint_add(&stage->config, "poses.control_heights", "%d", (int)c->poses.control_heights);
    add_hash(&stage->parent, "the control points", hash);
    return CN_OK;
}

void cn_stage_groups_key(const cn_city *city, const cn_photo_index *index, char key[17])
{
    const cn_pose_options *o = &city->config.poses;
    uint64_t hash = cn_hash_text(0, "%s %d %d %d %u %u %u %d %d %.9g %u %u",
                                 city->config.colmap ? city->config.colmap : "", (int)o->matcher, (int)o->match_with,
                                 (int)o->mapper, o->neighbours, o->max_image_px, o->max_features, (int)o->refine_focal,
                                 (int)o->single_camera, o->max_error_m, o->attempts, o->group_photos);
    for (uint32_t i = 0; i < index->n_photos; i++)
        hash = cn_hash_text(hash, "%s %016" PRIx64, index->photos[i].name, index->photos[i].hash);
    cn_hash_hex(hash, key);
}

/* The number of groups in groups.json; 0 when there is none. */
static cn_status count_groups(const cn_city *city, uint32_t *n)
{
    char *path = cn_city_path(city, "poses/groups/groups.json");
    json_t *root = NULL;
    if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    /* One that cannot be read is reported, or made again, later. */
    if (cn_file_exists(path) && cn_json_load(path, &root) != CN_OK) root = NULL;
    *n = (uint32_t)json_array_size(json_object_get(root, "groups"));
    json_decref(root);
    free(path);
    return CN_OK;
}

/* Poses are merged again when another group has been mapped, or mapped anew. */
static cn_status add_groups(const cn_city *city, cn_stage *stage)
{
    static const char *const FILES[] = { "group.json", "error.json" };
    uint64_t hash = 0;
    uint32_t n = 0;
    CN_TRY(count_groups(city, &n));
    for (uint32_t i = 0; i < 2 * n; i++) {
        char *path = cn_format("%s/poses/groups/%03u/%s", city->folder, i / 2 + 1, FILES[i % 2]);
        uint64_t one = 0;
        if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
        if (cn_file_exists(path) && cn_hash_file(path, &one) == CN_OK)
            hash = cn_hash_text(hash, "%u %016" PRIx64, i, one);
        free(path);
    }
    add_hash(&stage->parent, "the groups", hash);
    return CN_OK;
}

cn_status cn_stage_poses(const cn_city *city, const cn_photo_index *index, cn_stage *stage)
{
    const cn_config *c = &city->config;
    *stage = (cn_stage){ .record = "poses/stage.json",
                         .made = { "frame.json", "poses/poses.json", "poses/model/cameras.bin",
                                   "poses/model/images.bin", "poses/model/points3D.bin" } };
    uint64_t imported = 0, photos = 0;
    if (c->import) CN_TRY(hash_import(c->import, &imported));
    cn_fingerprint_add(&stage->config, "poses.import", "%s", c->import ? c->import : "");
    cn_fingerprint_add(&stage->config, "poses.colmap", "%s", c->colmap ? c->colmap : "");
    cn_fingerprint_add(&stage->config, "poses.matcher", "%d", c->poses.matcher);
    cn_fingerprint_add(&stage->config, "poses.neighbours", "%u", c->poses.neighbours);
    cn_fingerprint_add(&stage->config, "poses.max_image_px", "%u", c->poses.max_image_px);
    cn_fingerprint_add(&stage->config, "poses.refine_focal", "%d", c->poses.refine_focal);
    cn_fingerprint_add(&stage->config, "poses.single_camera", "%d", c->poses.single_camera);
    cn_fingerprint_add(&stage->config, "poses.max_error_m", "%.9g", c->poses.max_error_m);
    if (c->poses.check_import != cn_pose_options_default().check_import)
        cn_fingerprint_add(&stage->config, "poses.check_import", "%d", c->poses.check_import);
    if (c->poses.attempts != cn_pose_options_default().attempts)
        cn_fingerprint_add(&stage->config, "poses.attempts", "%u", c->poses.attempts);
    if (c->poses.match_with != cn_pose_options_default().match_with)
        cn_fingerprint_add(&stage->config, "poses.match_with", "%d", c->poses.match_with);
    if (c->poses.mapper != cn_pose_options_default().mapper)
        cn_fingerprint_add(&stage->config, "poses.mapper", "%d", c->poses.mapper);
    if (c->poses.group_photos != cn_pose_options_default().group_photos)
        cn_fingerprint_add(&stage->config, "poses.group_photos", "%u", c->poses.group_photos);
    if (c->control) CN_TRY(add_control(c, stage));
    if (cn_pose_is_grouped(index, &c->poses)) CN_TRY(add_groups(city, stage));
    for (uint32_t i = 0; i < index->n_photos; i++)
        photos = cn_hash_text(photos, "%s %016" PRIx64, index->photos[i].name, index->photos[i].hash);
    add_hash(&stage->parent, "the photos", photos);
    add_hash(&stage->parent, "the imported poses", imported);
    return CN_OK;
}

/* Adds the name and the bytes of a photo's map; nothing where it has none. */
static cn_status add_map(const cn_photo *photo, const char *map, uint64_t *hash)
{
    uint64_t one;
    if (!map) return CN_OK;
    CN_TRY(cn_hash_file(map, &one));
    *hash = cn_hash_text(*hash, "%s %016" PRIx64, photo->name, one);
    return CN_OK;
}

static cn_status load_photos(const cn_city *city, cn_photo_index *index)
{
    char *path = cn_city_path(city, "photos.json");
    const cn_status status = path ? cn_photo_index_load(index, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    return status;
}

/* Hashes of the depth maps and of the normal maps, and of how they are read. */
static cn_status hash_maps(const cn_photo_maps *maps, cn_photo_index *index, uint64_t *depth, uint64_t *normal)
{
    uint32_t n;
    *depth = cn_hash_text(0, "%d %d", (int)maps->kind, (int)maps->along);
    *normal = cn_hash_text(0, "%d", (int)maps->normal_axes);
    cn_status status = cn_photo_index_find_maps(index, maps, &n);
    for (uint32_t i = 0; i < index->n_photos && status == CN_OK; i++) {
        const cn_photo *photo = &index->photos[i];
        status = add_map(photo, photo->depth, depth);
        if (status == CN_OK) status = add_map(photo, photo->normal, normal);
    }
    return status;
}

/* Hash of the masks' bytes; 0 where no photo has a mask. One that cannot be read is reported later, when the photos are
 * read. */
static cn_status hash_masks(const cn_photo_index *index, uint64_t *hash)
{
    cn_status status = CN_OK;
    *hash = 0;
    for (uint32_t i = 0; i < index->n_photos && status == CN_OK; i++) {
        uint64_t one = 0;
        if (!index->photos[i].mask) continue;
        char *mask = cn_path_join(index->folder, index->photos[i].mask);
        if (!mask) status = cn_fail(CN_ERR_NOMEM, "out of memory");
        if (mask && cn_hash_file(mask, &one) != CN_OK) one = 0;
        *hash = cn_hash_text(*hash, "%s %016" PRIx64, index->photos[i].name, one);
        free(mask);
    }
    return status;
}

static cn_status add_masks_and_maps(const cn_city *city, cn_stage *stage)
{
    const cn_photo_maps *maps = &city->config.maps;
    const bool has_maps = maps->depth || maps->normal;
    cn_photo_index index;
    uint64_t masks = 0, depth = 0, normal = 0;
    CN_TRY(load_photos(city, &index));
    cn_status status = hash_masks(&index, &masks);
    if (status == CN_OK && has_maps) status = hash_maps(maps, &index, &depth, &normal);
    cn_photo_index_deinit(&index);
    CN_TRY(status);
    if (masks) add_hash(&stage->parent, "the masks", masks);
    if (maps->depth) add_hash(&stage->parent, "the depth maps", depth);
    if (maps->normal) add_hash(&stage->parent, "the normal maps", normal);
    return CN_OK;
}

cn_status cn_stage_plan(const cn_city *city, cn_stage *stage)
{
    const cn_config *c = &city->config;
    *stage = (cn_stage){ .record = "plan/stage.json", .made = { "plan/plan.json" } };
    uint64_t centres = 0;
    if (c->centres) CN_TRY(cn_hash_file(c->centres, &centres));
    cn_fingerprint_add(&stage->config, "photos.width_px", "%u", c->width_px);
    cn_fingerprint_add(&stage->config, "plan.layout", "%d", c->plan.layout);
    cn_fingerprint_add(&stage->config, "plan.centres", "%s", c->centres ? c->centres : "");
    add_hash(&stage->config, "the file of plan.centres", centres);
    cn_fingerprint_add(&stage->config, "plan.spacing_m", "%.9g", c->plan.spacing_m);
    cn_fingerprint_add(&stage->config, "plan.overlap", "%.9g", c->plan.overlap);
    cn_fingerprint_add(&stage->config, "plan.min_photos", "%u", c->plan.min_photos);
    cn_fingerprint_add(&stage->config, "plan.max_tile_photos", "%u", c->plan.max_tile_photos);
    cn_fingerprint_add(&stage->config, "plan.max_tile_gb", "%.9g", (double)c->plan.max_tile_bytes / 1e9);
    cn_fingerprint_add(&stage->config, "plan.hold_out_every", "%u", c->plan.hold_out_every);
    cn_fingerprint_add(&stage->config, "plan.probe_share", "%.9g", c->probe_share);
    cn_fingerprint_add(&stage->config, "train.quality", "%d", c->quality);
    for (uint32_t i = 0; i < cn_effect_count; i++) {
        char name[40];
        snprintf(name, sizeof name, "effects.%s", cn_effect_list[i]->name);
        cn_fingerprint_add(&stage->config, name, "%s",
                           c->effects[i] == CN_AUTO ? "auto"
                           : c->effects[i] == CN_ON ? "on"
                                                    : "off");
    }
    static const struct {
        const char *file, *name;
    } parents[] = { { "frame.json", "the frame" },
                    { "poses/model/images.bin", "the poses" },
                    { "poses/model/points3D.bin", "the sparse points" },
                    { "photos.json", "the list of photos" } };
    enum { LIST = 3 }; /* a city goes on where its photos were moved, or a file that is no photo lies beside them */
    for (size_t i = 0; i < sizeof parents / sizeof *parents; i++) {
        char *path = cn_city_path(city, parents[i].file);
        uint64_t hash;
        if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
        const bool there = cn_file_exists(path);
        cn_status status = CN_OK;
        if (there) status = i == LIST ? cn_photo_index_hash(path, &hash) : cn_hash_file(path, &hash);
        free(path);
        CN_TRY(status);
        if (!there)
            return cn_fail(CN_ERR_DATA, "%s has no poses yet; run `conurb poses %s` first", city->folder, city->folder);
        add_hash(&stage->parent, parents[i].name, hash);
    }
    return add_masks_and_maps(city, stage);
}

/* The teacher as it is named, and its file. */
static void add_teacher(cn_fingerprint *c, const char *teacher, const char *tile)
{
    uint64_t hash = 0;
    char *below = cn_format("%s/%s/tile.safetensors", teacher, tile);
    const char *path = below && cn_file_exists(below) ? below : teacher;
    cn_fingerprint_add(c, "field.teacher", "%s", teacher);
    if (cn_file_exists(path) && cn_hash_file(path, &hash) == CN_OK) add_hash(c, "the teacher", hash);
    free(below);
}

void cn_stage_tile(const cn_city *city, const cn_stage *plan, const cn_train_options *o, const cn_plan_tile *tile,
                   const cn_scene *scene, cn_stage *stage)
{
    *stage = (cn_stage){ 0 };
    snprintf(stage->record, sizeof stage->record, "tiles/%s/stage.json", tile->id);
    snprintf(stage->stamp, sizeof stage->stamp, "tiles/%s/DONE", tile->id);
    cn_fingerprint *c = &stage->config, *p = &stage->parent;
    cn_fingerprint_add(c, "train.seed", "%llu", (unsigned long long)o->seed);
    cn_fingerprint_add(c, "train.steps", "%u", cn_train_steps(o, tile));
    cn_fingerprint_add(c, "train.time_budget_s", "%.9g", o->time_budget_s);
    if (o->stop_gain_db > 0) cn_fingerprint_add(c, "train.stop_gain_db", "%.9g by validation photos", o->stop_gain_db);
    if (!o->leave_out_occluders) cn_fingerprint_add(c, "train.leave_out_occluders", "off");
    if (o->choose) cn_fingerprint_add(c, "settings", "chosen for the time");
    cn_fingerprint_add(c, "train.samples_per_step", "%u", o->samples_per_step);
    cn_fingerprint_add(c, "field.type", "%s", o->field.type);
    uint32_t n_options;
    const cn_field_option *options = cn_field_type_options(o->field.type, &n_options);
    for (uint32_t i = 0; i < n_options; i++) {
        char name[64];
        snprintf(name, sizeof name, "field.%s", options[i].name);
        cn_fingerprint_add(c, name, "%.9g", o->field.value[i]);
    }
    if (o->teacher) add_teacher(c, o->teacher, tile->id);
    cn_fingerprint_add(c, "train.learning_rate", "%.9g", o->learning_rate);
    cn_fingerprint_add(c, "train.march_step", "%.9g", o->march_step);
    cn_fingerprint_add(c, "train.precision", "%d", (int)o->precision);
    uint64_t place = 0, photos = 0, effects = 0;
    place = cn_hash_text(place, "%s|%.9g|%.9g|%.9g|%.9g|%.9g", tile->id, tile->centre[0], tile->centre[1],
                         tile->centre[2], tile->near_m, tile->far_m);
    for (int a = 0; a < 3; a++)
        place = cn_hash_text(place, "%.9g %.9g", tile->bounds_min[a], tile->bounds_max[a]);
    for (uint32_t i = 0; i < tile->n_photos; i++)
        photos = cn_hash_text(photos, "%s", scene->views[tile->photos[i]].name);
    for (uint32_t i = 0; i < tile->n_effects; i++)
        effects = cn_hash_text(effects, "%s=%d", tile->effects[i].name, tile->effects[i].on);
    cn_fingerprint_add(p, "photos.width_px", "%u", city->config.width_px);
    add_hash(p, "the tile's effects", effects);
    add_hash(p, "the tile's photos", photos);
    add_hash(p, "the tile's bounds", place);
    add_hash(p, "the poses", plan->parent.hash);
}

cn_status cn_stage_add_tiles(const cn_city *city, const cn_plan *plan, cn_stage *stage)
{
    for (uint32_t i = 0; i < plan->n_tiles; i++) {
        char *path = cn_format("%s/tiles/%s/DONE", city->folder, plan->tiles[i].id), *text = NULL,
             name[CN_TILE_ID_SIZE + 8];
        size_t size;
        if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
        snprintf(name, sizeof name, "tile %s", plan->tiles[i].id);
        const bool there = cn_file_exists(path) && cn_file_read(path, 1 << 16, &text, &size) == CN_OK;
        free(path);
        add_hash(&stage->parent, name, there ? cn_hash64(text, size) : 0);
        free(text);
    }
    return CN_OK;
}

cn_status cn_stage_eval(const cn_city *city, const cn_plan *plan, cn_stage *stage)
{
    const cn_compose_options *o = &city->config.compose;
    uint64_t colour;
    *stage = (cn_stage){ .record = "eval/stage.json", .made = { "eval/eval.json" } };
    CN_TRY(cn_colour_config_hash("", &colour)); /* scores are not by $OCIO */
    add_hash(&stage->config, "the OpenColorIO config", colour);
    cn_fingerprint_add(&stage->config, "compose.scheme", "%s", cn_blend_name(o->scheme));
    cn_fingerprint_add(&stage->config, "compose.exponent", "%.9g", o->exponent);
    cn_fingerprint_add(&stage->config, "compose.reach", "%.9g", o->reach);
    cn_fingerprint_add(&stage->config, "compose.max_tiles", "%u", o->max_tiles);
    cn_fingerprint_add(&stage->config, "compose.min_visibility", "%.9g", o->min_visibility);
    cn_fingerprint_add(&stage->config, "compose.match", "%d", city->config.match);
    cn_stage poses;
    CN_TRY(cn_stage_plan(city, &poses));
    add_hash(&stage->parent, "the poses", poses.parent.hash);
    uint64_t held = 0;
    for (uint32_t i = 0; i < plan->n_tiles; i++)
        for (uint32_t h = 0; h < plan->tiles[i].n_held_out; h++)
            held = cn_hash_text(held, "%s %u", plan->tiles[i].id, plan->tiles[i].held_out[h]);
    add_hash(&stage->parent, "the held-out photos", held);
    return cn_stage_add_tiles(city, plan, stage);
}
