#include "pose/grouped.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/json.h"
#include "pose/from_photos.h"
#include "pose/retrieval.h"
#include "pose/colmap.h"
#include "pose/scene.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { GROUP_VERSION = 1, LARGER = 2 }; /* times group_photos from which photos are posed in groups */

bool cn_pose_is_grouped(const cn_photo_index *index, const cn_pose_options *options)
{
    return !options->import && options->group_photos && index->n_photos > LARGER * (uint64_t)options->group_photos;
}

char *cn_group_path(const char *dir, uint32_t group, const char *name)
{
    return name ? cn_format("%s/groups/%03u/%s", dir, group + 1, name) : cn_format("%s/groups/%03u", dir, group + 1);
}

char *cn_group_list(const char *dir)
{
    return cn_path_join(dir, "groups/groups.json");
}

/* ---- Splitting ---- */

/* Pairs of photos that look alike, from the features of the whole collection. */
static cn_status retrieve(const cn_context *ctx, const cn_pose_work *work, cn_photo_pairs *pairs)
{
    char *dir = cn_path_join(work->dir, "groups/alike");
    cn_status status = dir ? cn_folder_make(dir) : cn_fail(CN_ERR_NOMEM, "out of memory");
    const cn_colmap_task task = { .ctx = ctx, .index = work->index, .dir = dir, .options = work->options };
    if (status == CN_OK) status = cn_colmap_alike(&task, pairs);
    free(dir);
    return status;
}

/* What photos may match: neighbours by GPS, in the order of a walk, or those that look alike. */
static cn_status find_pairs(const cn_context *ctx, const cn_pose_work *work, double (**places)[2],
                            cn_photo_pairs *pairs, const char **by)
{
    const cn_pose_options *o = work->options;
    *places = NULL;
    *by = "order";
    if (o->matcher == CN_MATCH_SEQUENTIAL) return cn_photo_pairs_in_sequence(work->index, pairs);
    if (o->matcher == CN_MATCH_AUTO || o->matcher == CN_MATCH_GPS) CN_TRY(cn_photo_places(work->index, places));
    *by = *places ? "GPS" : "likeness";
    return *places ? cn_photo_pairs_near(work->index, o->neighbours, pairs) : retrieve(ctx, work, pairs);
}

static cn_status split(const cn_context *ctx, const cn_pose_work *work, const char *path, cn_photo_groups *groups)
{
    double(*places)[2];
    const char *by;
    cn_photo_pairs pairs = { 0 };
    CN_TRY(find_pairs(ctx, work, &places, &pairs, &by));
    const cn_group_split how = { work->index->n_photos, (const double(*)[2])places, &pairs,
                                 work->options->group_photos };
    cn_status status = cn_photo_groups_split(&how, groups);
    cn_photo_pairs_deinit(&pairs);
    free(places);
    CN_TRY(status);
    uint64_t shared = 0;
    for (uint32_t i = 0; i < groups->n; i++)
        shared += groups->groups[i].n - groups->groups[i].n_core;
    cn_log(ctx, CN_LOG_INFO, "%u photos in %u groups of at most %u, by %s; %.0f %% of a group are its neighbours'",
           work->index->n_photos, groups->n, how.most, by,
           100.0 * (double)shared / ((double)shared + work->index->n_photos));
    return cn_photo_groups_save(groups, work->key, by, path);
}

cn_status cn_pose_split(const cn_context *ctx, const cn_pose_work *work, uint32_t *n_groups)
{
    cn_photo_groups groups;
    char *dir = cn_path_join(work->dir, "groups"), *path = cn_group_list(work->dir);
    char *photos = cn_path_join(work->dir, "groups/photos.json");
    cn_status status = dir && path && photos ? cn_folder_make(dir) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && cn_file_exists(photos) &&
        cn_photo_groups_load(&groups, work->key, work->index->n_photos, path) == CN_OK) {
        *n_groups = groups.n;
        cn_photo_groups_deinit(&groups);
    } else if (status == CN_OK) {
        status = cn_photo_index_save(work->index, photos);
        if (status == CN_OK) status = split(ctx, work, path, &groups);
        *n_groups = status == CN_OK ? groups.n : 0;
        if (status == CN_OK) cn_photo_groups_deinit(&groups);
    }
    free(dir);
    free(path);
    free(photos);
    return status;
}

/* ---- One group ---- */

static int by_name(const void *a, const void *b)
{
    return strcmp(((const cn_photo *)a)->name, ((const cn_photo *)b)->name);
}

cn_status cn_group_index(const cn_photo_index *index, const cn_photo_group *group, cn_photo_index *sub)
{
    *sub = (cn_photo_index){ .folder = index->folder, .n_photos = group->n };
    sub->photos = malloc((group->n + (size_t)1) * sizeof *sub->photos);
    if (!sub->photos) return cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < group->n; i++) {
        sub->photos[i] = index->photos[group->photos[i]];
        sub->n_gps += sub->photos[i].has_gps;
    }
    qsort(sub->photos, sub->n_photos, sizeof *sub->photos, by_name);
    return CN_OK;
}

/* group.json or error.json of this key; NULL: there is none. */
static json_t *load_record(const char *dir, uint32_t group, const char *name, const char *key)
{
    char *path = cn_group_path(dir, group, name);
    json_t *root = NULL;
    if (path && cn_file_exists(path) && cn_json_load(path, &root) != CN_OK) root = NULL;
    free(path);
    const char *theirs = json_string_value(json_object_get(root, "key"));
    if (theirs && strcmp(theirs, key) == 0) return root;
    json_decref(root);
    return NULL;
}

static cn_status save_record(const char *dir, uint32_t group, const char *name, json_t *root)
{
    char *path = cn_group_path(dir, group, name);
    const cn_status status = path && root ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    json_decref(root);
    free(path);
    return status;
}

cn_pose_group_state cn_pose_group_look(const cn_pose_work *work, uint32_t group)
{
    json_t *done = load_record(work->dir, group, "group.json", work->key);
    json_t *error = done ? NULL : load_record(work->dir, group, "error.json", work->key);
    const json_int_t status = json_integer_value(json_object_get(error, "status"));
    const cn_pose_group_state state = done                    ? CN_POSE_GROUP_DONE
                                      : !error                ? CN_POSE_GROUP_DUE
                                      : status == CN_ERR_DATA ? CN_POSE_GROUP_HOPELESS
                                                              : CN_POSE_GROUP_FAILED;
    json_decref(done);
    json_decref(error);
    return state;
}

bool *cn_group_core(const cn_photo_index *index, const cn_photo_group *group, const cn_photo_index *sub)
{
    bool *core = calloc(sub->n_photos + (size_t)1, sizeof *core);
    for (uint32_t i = 0; core && i < group->n_core; i++) {
        const cn_photo *photo =
            bsearch(&index->photos[group->photos[i]], sub->photos, sub->n_photos, sizeof *sub->photos, by_name);
        if (photo) core[photo - sub->photos] = true;
    }
    return core;
}

/* Poses a group's photos, and keeps the model in the group's folder. */
static cn_status map_group(const cn_context *ctx, const cn_pose_work *work, const cn_photo_index *sub, uint32_t group,
                           const cn_photo_group *photos)
{
    char *dir = cn_group_path(work->dir, group, NULL), *model = cn_group_path(work->dir, group, "model");
    bool *core = cn_group_core(work->index, photos, sub);
    cn_colmap_choice choice = { 0 };
    const cn_colmap_task task = { .ctx = ctx,
                                  .index = sub,
                                  .dir = dir,
                                  .options = work->options,
                                  .core = core,
                                  .choice = &choice,
                                  .colmaps_global = true };
    const double began_s = cn_now_s();
    cn_scene scene = { 0 };
    cn_frame frame;
    uint32_t n_models = 0;
    cn_status status = dir && model && core ? cn_folder_make(dir) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_pose_from_photos(&task, &scene, &frame, &n_models);
    if (status == CN_OK) status = cn_folder_remove(model);
    if (status == CN_OK) status = cn_scene_write_colmap(&scene, model);
    if (status == CN_OK)
        status =
            save_record(work->dir, group, "group.json",
                        json_pack("{s:i,s:s,s:i,s:i,s:i,s:i,s:i,s:f,s:i,s:s,s:f}", "version", GROUP_VERSION, "key",
                                  work->key, "photos", (int)photos->n, "core", (int)photos->n_core, "registered",
                                  (int)scene.n_views, "sparse_points", (int)scene.n_points, "models", (int)n_models,
                                  "error_px", cn_scene_measure_errors(&scene), "attempt", (int)choice.attempt, "way",
                                  choice.way ? choice.way : "", "seconds", cn_now_s() - began_s));
    cn_scene_deinit(&scene);
    free(choice.database);
    free(core);
    free(dir);
    free(model);
    return status;
}

/* Keeps the reason for `conurb status` and the report. What fails here failed because of what failed before. */
static void record_failure(const cn_pose_work *work, uint32_t group, cn_status status)
{
    char why[600];
    snprintf(why, sizeof why, "%s", cn_error_message());
    json_t *root = json_pack("{s:i,s:s,s:s,s:i}", "version", GROUP_VERSION, "key", work->key, "message", why, "status",
                             (int)status);
    if (root) (void)!save_record(work->dir, group, "error.json", root);
    (void)!cn_fail(status, "%s", why);
}

cn_status cn_pose_map_group(const cn_context *ctx, const cn_pose_work *work, uint32_t group)
{
    cn_photo_groups groups;
    cn_photo_index sub = { 0 };
    char *path = cn_group_list(work->dir), *error = cn_group_path(work->dir, group, "error.json");
    cn_status status = path && error ? cn_photo_groups_load(&groups, work->key, work->index->n_photos, path)
                                     : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    if (status != CN_OK) {
        free(error);
        return status;
    }
    if (group >= groups.n)
        status = cn_fail(CN_ERR_USAGE, "there is no group %u; the groups are 1 to %u", group + 1, groups.n);
    if (status == CN_OK) status = cn_file_remove(error);
    if (status == CN_OK) status = cn_group_index(work->index, &groups.groups[group], &sub);
    if (status == CN_OK) {
        status = map_group(ctx, work, &sub, group, &groups.groups[group]);
        if (status != CN_OK && status != CN_ERR_INTERRUPTED) record_failure(work, group, status);
    }
    free(sub.photos);
    free(error);
    cn_photo_groups_deinit(&groups);
    return status;
}

/* ---- All groups ---- */

void cn_grouped_deinit(cn_grouped *g)
{
    cn_photo_groups_deinit(&g->groups);
    cn_merge_report_deinit(&g->report);
    free(g->rows);
    g->rows = NULL;
}

static cn_status load_model(const cn_context *ctx, const cn_pose_work *work, uint32_t group, cn_scene *model)
{
    char *path = cn_group_path(work->dir, group, "model");
    uint32_t n_lost = 0;
    cn_status status = path ? cn_scene_read_colmap(model, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_scene_tie(model, work->index, &n_lost);
    if (status == CN_OK && n_lost)
        cn_log(ctx, CN_LOG_WARN, "%s: %u of its photos are not in the collection", path, n_lost);
    free(path);
    return status;
}

/* The model of a group that has one, and what the report says of the group. */
static cn_status load_group(const cn_context *ctx, const cn_pose_work *work, uint32_t group, cn_group_row *row,
                            cn_scene *model)
{
    json_t *done = load_record(work->dir, group, "group.json", work->key);
    json_t *error = done ? NULL : load_record(work->dir, group, "error.json", work->key);
    cn_status status = CN_OK;
    const char *why = json_string_value(json_object_get(error, "message"));
    const char *way = json_string_value(json_object_get(done, "way"));
    snprintf(row->way, sizeof row->way, "%s", way ? way : "");
    snprintf(row->why, sizeof row->why, "%s", why ? why : "");
    row->attempt = (uint32_t)json_integer_value(json_object_get(done, "attempt"));
    if (done)
        status = load_model(ctx, work, group, model);
    else if (error)
        cn_log(ctx, CN_LOG_WARN, "group %u failed, and the others go on without it: %s", group + 1, row->why);
    else
        status = cn_fail(CN_ERR_DATA,
                         "group %u of %s is not mapped yet (it was stopped or killed, or waits); run conurb poses or "
                         "conurb submit again",
                         group + 1, work->dir);
    json_decref(done);
    json_decref(error);
    return status;
}

static void tell(const cn_context *ctx, const cn_grouped *g, const cn_scene *scene, const cn_frame *frame)
{
    const cn_merge_report *r = &g->report;
    for (uint32_t i = 0; i < r->n_groups; i++)
        if (r->groups[i].fate == CN_GROUP_APART)
            cn_log(ctx, CN_LOG_WARN,
                   "group %u has poses of %u photos, but neither shared photos nor GPS tie them to the others: they "
                   "are left out",
                   i + 1, r->groups[i].n_posed);
    cn_log(ctx, CN_LOG_INFO, "%u of %u groups joined in %.0f s, and %u photos adjusted %s in %.0f s", r->n_joined,
           r->n_groups, r->join_s, scene->n_views, r->way == CN_MERGE_WHOLE ? "at once" : "group by group",
           r->adjust_s);
    if (frame->georeferenced)
        cn_log(ctx, CN_LOG_INFO, "of %u photos with GPS %u agree: residual %.3f m horizontally, %.3f m vertically",
               frame->n_gps, frame->n_inliers, frame->residual_horizontal_m, frame->residual_vertical_m);
}

static cn_status load_and_merge(const cn_context *ctx, const cn_pose_work *work, cn_scene *models, cn_scene *scene,
                                cn_frame *frame, cn_grouped *g)
{
    for (uint32_t i = 0; i < g->groups.n; i++) {
        g->rows[i].n = g->groups.groups[i].n;
        g->rows[i].n_core = g->groups.groups[i].n_core;
        CN_TRY(load_group(ctx, work, i, &g->rows[i], &models[i]));
    }
    const cn_merge_task task = { work->index, &g->groups, models, work->options, cn_merge_memory() };
    CN_TRY(cn_groups_merge(ctx, &task, scene, frame, &g->report));
    tell(ctx, g, scene, frame);
    return CN_OK;
}

cn_status cn_grouped_merge(const cn_context *ctx, const cn_pose_work *work, cn_scene *scene, cn_frame *frame,
                           cn_grouped *g)
{
    char *path = cn_group_list(work->dir);
    *g = (cn_grouped){ 0 };
    cn_status status = path ? cn_photo_groups_load(&g->groups, work->key, work->index->n_photos, path)
                            : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    CN_TRY(status);
    cn_scene *models = calloc(g->groups.n + (size_t)1, sizeof *models);
    g->rows = calloc(g->groups.n + (size_t)1, sizeof *g->rows);
    status =
        models && g->rows ? load_and_merge(ctx, work, models, scene, frame, g) : cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; models && i < g->groups.n; i++)
        cn_scene_deinit(&models[i]);
    free(models);
    return status;
}
