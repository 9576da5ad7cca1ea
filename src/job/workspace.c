#include "job/workspace.h"

#include "base/file.h"
#include "base/hash.h"
#include "base/json.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { RECORD_FORMAT = 1 };

char *cn_city_path(const cn_city *city, const char *name) { return cn_path_join(city->folder, name); }
const char *cn_city_folder(const cn_city *city) { return city->folder; }

cn_status cn_city_open(cn_city **city, const char *folder)
{
    *city = calloc(1, sizeof **city);
    if (!*city) return cn_fail(CN_ERR_NOMEM, "out of memory while opening %s", folder);
    cn_status status = cn_path_absolute(folder, &(*city)->folder);
    if (status != CN_OK) status = cn_fail(CN_ERR_USAGE, "%s is not there; make a city with `conurb init %s --photos DIR`", folder, folder);
    if (status == CN_OK) status = cn_config_load(&(*city)->config, (*city)->folder);
    if (status != CN_OK) cn_city_close(city);
    return status;
}

void cn_city_close(cn_city **city)
{
    if (!*city) return;
    cn_config_deinit(&(*city)->config);
    free((*city)->folder);
    free(*city);
    *city = NULL;
}

/* A workspace that could not be finished is taken back, so that `init` can be tried again. */
static cn_status write_city(const cn_context *ctx, const char *folder, const char *photos, const char *import, uint32_t width_px)
{
    char *path = cn_path_join(folder, "city.yaml");
    char *text = cn_config_template(photos, import, width_px ? width_px : 800);
    cn_status status = path && text ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory while making %s", folder);
    if (status == CN_OK && cn_file_exists(path))
        status = cn_fail(CN_ERR_USAGE, "%s already is a city; edit its city.yaml, or choose another name", folder);
    if (status == CN_OK) status = cn_folder_make(folder);
    if (status == CN_OK) status = cn_file_write(path, text, strlen(text));
    if (status == CN_OK) cn_log(ctx, CN_LOG_INFO, "made %s", path);
    free(text);
    free(path);
    return status;
}

cn_status cn_city_init(const cn_context *ctx, const char *city, const cn_init_options *options)
{
    if (!options->photos) return cn_fail(CN_ERR_USAGE, "--photos DIR is missing: name the folder that holds the photos");
    if (options->width_px && (options->width_px < 16 || options->width_px > 65535))
        return cn_fail(CN_ERR_USAGE, "--width %u: give 16 to 65535 pixels", options->width_px);
    char *photos = NULL, *import = NULL;
    cn_status status = cn_path_absolute(options->photos, &photos);
    if (status != CN_OK) status = cn_fail(CN_ERR_DATA, "the photo folder %s is not there; name the folder that holds the photos", options->photos);
    if (status == CN_OK && options->import) status = cn_path_absolute(options->import, &import);
    if (status != CN_OK && photos) status = cn_fail(CN_ERR_DATA, "%s is not there; name a COLMAP model folder or a transforms.json", options->import);
    if (status == CN_OK) status = write_city(ctx, city, photos, import, options->width_px);
    free(photos);
    free(import);
    return status;
}

uint64_t cn_hash_text(uint64_t hash, const char *format, ...)
{
    char text[1024];
    va_list args;
    va_start(args, format);
    const int n = snprintf(text, 24, "%016" PRIx64 " ", hash);
    vsnprintf(text + n, sizeof text - (size_t)n, format, args);
    va_end(args);
    return cn_hash64(text, strlen(text));
}

uint64_t cn_stage_hash(const cn_stage *stage) { return cn_hash_text(stage->config, "%016" PRIx64, stage->parent); }

bool cn_stage_done(const cn_city *city, const cn_stage *stage, const char *artefact)
{
    char *path = cn_city_path(city, stage->record), *file = artefact ? cn_city_path(city, artefact) : NULL;
    json_t *root = NULL;
    bool done = path && cn_file_exists(path) && (!artefact || (file && cn_file_exists(file))) && cn_json_load(path, &root) == CN_OK;
    if (done) {
        char hex[17];
        const char *config, *parent;
        done = cn_json_string(root, path, "config", &config) == CN_OK && cn_json_string(root, path, "parent", &parent) == CN_OK;
        if (done) cn_hash_hex(stage->config, hex), done = strcmp(hex, config) == 0;
        if (done) cn_hash_hex(stage->parent, hex), done = strcmp(hex, parent) == 0;
    }
    json_decref(root);
    free(path);
    free(file);
    return done;
}

cn_status cn_stage_finish(const cn_city *city, const cn_stage *stage)
{
    char config[17], parent[17];
    cn_hash_hex(stage->config, config);
    cn_hash_hex(stage->parent, parent);
    char *path = cn_city_path(city, stage->record);
    json_t *root = json_pack("{s:i,s:s,s:s,s:s}", "version", RECORD_FORMAT, "config", config, "parent", parent, "conurb", cn_version());
    const cn_status status = path && root ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    json_decref(root);
    free(path);
    return status;
}

/* Of a transforms.json, or of the files of a COLMAP model that are there. What cannot be read is the importer's to name. */
static cn_status hash_import(const char *import, uint64_t *hash)
{
    static const char *const files[] = {"cameras.bin", "images.bin", "points3D.bin", "cameras.txt", "images.txt", "points3D.txt"};
    uint64_t one;
    *hash = 0;
    if (cn_hash_file(import, &one) == CN_OK) *hash = one;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        char *path = cn_path_join(import, files[i]);
        if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
        if (cn_file_exists(path) && cn_hash_file(path, &one) == CN_OK)
            *hash = cn_hash_text(*hash, "%s %016" PRIx64, files[i], one);
        free(path);
    }
    return CN_OK;
}

cn_status cn_stage_poses(const cn_city *city, const cn_photo_index *index, cn_stage *stage)
{
    const cn_config *c = &city->config;
    *stage = (cn_stage){.record = "poses/stage.json"};
    uint64_t imported = 0;
    if (c->import) CN_TRY(hash_import(c->import, &imported));
    stage->config = cn_hash_text(imported, "%s|%s|%d|%u|%u|%d|%d|%.9g", c->import ? c->import : "", c->colmap ? c->colmap : "", c->poses.matcher,
                                 c->poses.neighbours, c->poses.max_image_px, c->poses.refine_focal, c->poses.single_camera, c->poses.max_error_m);
    for (uint32_t i = 0; i < index->n_photos; i++)
        stage->parent = cn_hash_text(stage->parent, "%s %016" PRIx64, index->photos[i].name, index->photos[i].hash);
    return CN_OK;
}

cn_status cn_stage_plan(const cn_city *city, cn_stage *stage)
{
    const cn_config *c = &city->config;
    *stage = (cn_stage){.record = "plan/stage.json"};
    uint64_t centres = 0;
    if (c->centres) CN_TRY(cn_hash_file(c->centres, &centres));
    stage->config = cn_hash_text(centres, "%u|%d|%s|%.9g|%.9g|%u|%u|%d", c->width_px, c->plan.layout, c->centres ? c->centres : "", c->plan.spacing_m,
                                 c->plan.overlap, c->plan.min_photos, c->plan.hold_out_every, c->quality);
    for (uint32_t i = 0; i < cn_config_n_effects; i++) stage->config = cn_hash_text(stage->config, "%d", c->effects[i]);
    static const char *const parents[] = {"frame.json", "poses/model/images.bin", "poses/model/points3D.bin", "photos.json"};
    for (size_t i = 0; i < sizeof parents / sizeof *parents; i++) {
        char *path = cn_city_path(city, parents[i]);
        uint64_t hash;
        if (!path) return cn_fail(CN_ERR_NOMEM, "out of memory");
        const cn_status status = cn_hash_file(path, &hash);
        free(path);
        if (status != CN_OK) return cn_fail(CN_ERR_DATA, "%s has no poses yet; run `conurb poses %s` first", city->folder, city->folder);
        stage->parent = cn_hash_text(stage->parent, "%016" PRIx64, hash);
    }
    return CN_OK;
}

cn_status cn_stage_tile(const cn_city *city, const cn_train_options *o, const cn_plan_tile *tile, const cn_scene *scene, char *record, size_t size,
                        cn_stage *stage)
{
    snprintf(record, size, "tiles/%s/stage.json", tile->id);
    *stage = (cn_stage){.record = record};
    stage->config = cn_hash_text(0, "%llu|%u|%.9g|%u|%u|%u|%u|%u|%u|%u|%.9g|%.9g", (unsigned long long)o->seed, o->steps, o->time_budget_s,
                                 o->samples_per_step, o->levels, o->log2_table, o->base_resolution, o->finest_resolution, o->density_width,
                                 o->colour_width, o->learning_rate, o->march_step);
    cn_stage plan;
    CN_TRY(cn_stage_plan(city, &plan));
    stage->parent = cn_hash_text(plan.parent, "%s|%u|%.9g|%.9g|%.9g|%.9g|%.9g", tile->id, city->config.width_px, tile->centre[0], tile->centre[1],
                                 tile->centre[2], tile->near_m, tile->far_m);
    for (int a = 0; a < 3; a++) stage->parent = cn_hash_text(stage->parent, "%.9g %.9g", tile->bounds_min[a], tile->bounds_max[a]);
    for (uint32_t i = 0; i < tile->n_photos; i++) stage->parent = cn_hash_text(stage->parent, "%s", scene->views[tile->photos[i]].name);
    for (uint32_t i = 0; i < tile->n_effects; i++) stage->parent = cn_hash_text(stage->parent, "%s=%d", tile->effects[i].name, tile->effects[i].on);
    return CN_OK;
}

static cn_status load_one(const cn_city *city, const char *name, const char *command, char **path)
{
    *path = cn_city_path(city, name);
    if (!*path) return cn_fail(CN_ERR_NOMEM, "out of memory");
    if (cn_file_exists(*path)) return CN_OK;
    free(*path);
    *path = NULL;
    return cn_fail(CN_ERR_DATA, "%s has no %s yet; run `conurb %s %s` first", city->folder, name, command, city->folder);
}

static cn_status load_all(const cn_context *ctx, const cn_city *city, bool with_plan, cn_material *m)
{
    char *path;
    CN_TRY(load_one(city, "photos.json", "poses", &path));
    cn_status status = cn_photo_index_load(&m->photos, path);
    free(path);
    CN_TRY(status);
    CN_TRY(load_one(city, "frame.json", "poses", &path));
    status = cn_frame_load(&m->frame, path);
    free(path);
    CN_TRY(status);
    CN_TRY(load_one(city, "poses", "poses", &path));
    status = cn_pose_load(ctx, path, &m->photos, &m->scene);
    free(path);
    CN_TRY(status);
    if (!with_plan) return CN_OK;
    CN_TRY(load_one(city, "plan/plan.json", "plan", &path));
    free(path);
    CN_TRY(load_one(city, "pixels.bin", "plan", &path));
    status = cn_pixel_store_open(&m->pixels, path);
    free(path);
    CN_TRY(status);
    path = cn_city_path(city, "plan");
    status = path ? cn_plan_load(&m->plan, &m->scene, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    return status;
}

cn_status cn_material_load(const cn_context *ctx, const cn_city *city, bool with_plan, cn_material *material)
{
    *material = (cn_material){0};
    const cn_status status = load_all(ctx, city, with_plan, material);
    if (status != CN_OK) cn_material_deinit(material);
    return status;
}

void cn_material_deinit(cn_material *material)
{
    cn_plan_deinit(&material->plan);
    cn_pixel_store_close(&material->pixels);
    cn_scene_deinit(&material->scene);
    cn_photo_index_deinit(&material->photos);
    *material = (cn_material){0};
}
