/* The poses stage. */
#include "base/file.h"
#include "base/json.h"
#include "pose/control_fit.h"
#include "pose/from_photos.h"
#include "pose/grouped.h"
#include "pose/import.h"
#include "pose/import_check.h"
#include "pose/lens.h"
#include "pose/outlier.h"
#include "pose/quality.h"
#include "pose/result.h"
#include "pose/scene.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define POSES_VERSION 1
#define NAMED_AT_MOST 10

cn_pose_options cn_pose_options_default(void)
{
    return (cn_pose_options){ .colmap = "colmap",
                              .matcher = CN_MATCH_AUTO,
                              .neighbours = 20,
                              .max_image_px = 1600,
                              .max_features = 8192,
                              .refine_focal = CN_AUTO,
                              .check_import = CN_AUTO,
                              .single_camera = true,
                              .max_error_m = 5.0,
                              .attempts = CN_MOST_ATTEMPTS,
                              .group_photos = 200 };
}

void cn_pose_report_deinit(cn_pose_report *report)
{
    for (uint32_t i = 0; i < report->n_unregistered && report->unregistered; i++)
        free(report->unregistered[i]);
    free(report->unregistered);
    memset(report, 0, sizeof *report);
}

static cn_status check_cameras(const cn_scene *scene, const char *where)
{
    for (uint32_t i = 0; i < scene->n_views; i++) {
        const cn_camera *camera = &scene->cameras[scene->views[i].camera];
        char *who = cn_format("camera %u of photo %s", camera->id, scene->views[i].name);
        const cn_status status =
            who ? cn_camera_check_inverse(camera, where, who) : cn_fail(CN_ERR_NOMEM, "out of memory");
        free(who);
        CN_TRY(status);
    }
    return CN_OK;
}

static cn_status import_model(const cn_context *ctx, const cn_photo_index *index, const char *model, cn_scene *scene)
{
    double lens_fit_px;
    cn_status status = cn_model_read(scene, model, &lens_fit_px);
    if (status == CN_OK && lens_fit_px > 0.1)
        cn_log(ctx, CN_LOG_INFO, "%s: its lens model is one that Conurb lacks; it is approximated within %.2f px",
               model, lens_fit_px);
    if (status == CN_OK) status = check_cameras(scene, model);
    if (status == CN_OK) status = cn_pose_tie(ctx, scene, index, true, model);
    return status;
}

static cn_status import_poses(const cn_context *ctx, const cn_photo_index *index, const char *path, cn_scene *scene,
                              uint32_t *n_models, cn_import_origin *origin)
{
    cn_import_source source;
    CN_TRY(cn_import_find(path, &source));
    *n_models = source.keyframes ? 1 : source.n_models;
    origin->arbitrary_axes = source.model != NULL;
    /* Where nothing was found, the reader of COLMAP models says what is missing. */
    const cn_status status = source.file        ? cn_import_file(ctx, source.file, index, scene, n_models, origin)
                             : source.keyframes ? cn_import_folder(ctx, source.keyframes, index, scene)
                                                : import_model(ctx, index, source.model ? source.model : path, scene);
    cn_import_source_deinit(&source);
    return status;
}

/* Imported poses, in the frame of their file or of the photos' GPS. */
static cn_status run_import(const cn_colmap_task *task, cn_posed *out)
{
    const cn_pose_options *options = task->options;
    cn_import_origin origin = { 0 };
    CN_TRY(import_poses(task->ctx, task->index, options->import, &out->scene, &out->n_models, &origin));
    CN_TRY(cn_pose_drop_outliers(task->ctx, &out->scene));
    CN_TRY(cn_import_place(task->ctx, &out->scene, task->index, options->max_error_m, &origin, &out->frame));
    return cn_import_check(task, out);
}

/* Imported poses stay as they are, unless there are control points. */
static cn_status apply_control(const cn_colmap_task *task, const cn_control *control, cn_posed *posed,
                               cn_control_fit *fit)
{
    const cn_pose_options *options = task->options;
    const cn_control_task with = { options->control ? control : NULL, task->index, options };
    *fit = (cn_control_fit){ 0 };
    const bool by_gps = !options->import && posed->frame.georeferenced && cn_control_has_accurate_gps(task->index);
    return with.control || by_gps ? cn_control_apply(task->ctx, &with, &posed->scene, &posed->frame, fit) : CN_OK;
}

static double length(const double v[3])
{
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

static cn_status make_report(cn_scene *scene, const cn_photo_index *index, uint32_t n_models, cn_pose_report *report)
{
    bool *posed = calloc(index->n_photos + (size_t)1, 1);
    memset(report, 0, sizeof *report);
    report->unregistered = calloc(index->n_photos + (size_t)1, sizeof *report->unregistered);
    cn_status status = posed && report->unregistered ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < scene->n_views && status == CN_OK; i++)
        posed[scene->views[i].photo] = true;
    for (uint32_t i = 0; i < index->n_photos && status == CN_OK; i++) {
        if (posed[i]) continue;
        char *name = strdup(index->photos[i].name);
        if (name)
            report->unregistered[report->n_unregistered++] = name;
        else
            status = cn_fail(CN_ERR_NOMEM, "out of memory");
    }
    report->n_registered = scene->n_views;
    report->n_models = n_models;
    report->mean_error_px = cn_scene_measure_errors(scene);
    free(posed);
    if (status != CN_OK) cn_pose_report_deinit(report);
    return status;
}

static void log_report(const cn_context *ctx, const cn_pose_report *report, const cn_scene *scene,
                       const cn_frame *frame, bool has_exif_focal)
{
    if (scene->n_points)
        cn_log(ctx, CN_LOG_INFO, "%u photos posed, %u not; %u sparse points, mean error %.2f px", report->n_registered,
               report->n_unregistered, scene->n_points, report->mean_error_px);
    else
        cn_log(ctx, CN_LOG_INFO, "%u photos posed, %u not; the poses came without sparse points", report->n_registered,
               report->n_unregistered);
    for (uint32_t i = 0; i < report->n_unregistered && i < NAMED_AT_MOST; i++)
        cn_log(ctx, CN_LOG_WARN, "no pose found for photo %s", report->unregistered[i]);
    if (report->n_models > 1)
        cn_log(ctx, CN_LOG_WARN,
               "the poses are in %u separate parts; the largest is used (photos in between would join them)",
               report->n_models);
    if (frame->nadir_ambiguous)
        cn_log(ctx, CN_LOG_WARN,
               "all photos look straight down on flat ground, where focal length and height cannot be separated%s; add "
               "a few oblique photos",
               has_exif_focal ? ": heights rest on the focal length of EXIF or of the import" : "");
}

static cn_status save_report(const cn_pose_report *report, const cn_frame *frame, const char *path)
{
    json_t *names = json_array();
    for (uint32_t i = 0; i < report->n_unregistered; i++) {
        json_t *name = json_string(report->unregistered[i]);
        json_array_append_new(names, name ? name : json_string("(a name that is not UTF-8)"));
    }
    json_t *root =
        json_pack("{s:i, s:i, s:o, s:i, s:o, s:b}", "version", POSES_VERSION, "registered", (int)report->n_registered,
                  "unregistered", names, "models", (int)report->n_models, "mean_error_px",
                  cn_json_real(report->mean_error_px), "georeferenced", (int)frame->georeferenced);
    if (root && report->n_control + report->n_check) {
        json_object_set_new(root, "control_rms_m", cn_json_real(report->control_rms_m));
        json_object_set_new(root, "check_rms_m", cn_json_real(report->check_rms_m));
    }
    cn_status status = root ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "%s: out of memory", path);
    json_decref(root);
    return status;
}

/* The new model replaces the old one only when it is complete. */
static cn_status swap_model(const char *fresh, const char *model, const char *done)
{
    CN_TRY(cn_file_remove(done));
    CN_TRY(cn_folder_remove(model));
    if (rename(fresh, model) == 0) return CN_OK;
    return cn_fail(CN_ERR_IO, "%s: cannot be renamed to %s: %s", fresh, model, strerror(errno));
}

/* What is known of the poses beside themselves. */
typedef struct found {
    cn_posed posed;
    cn_control control;
    cn_control_fit fit;
    cn_colmap_choice choice; /* attempt 0: imported */
    cn_grouped grouped;      /* without rows: not posed in groups */
} found;

/* report.json and report.html: how good the poses are, and why photos have none. */
static cn_status save_quality(const cn_colmap_task *task, const found *f)
{
    const bool grouped = f->grouped.rows, by_colmap = f->choice.attempt > 0 || grouped;
    const cn_quality_task how = { task->ctx, task->options, by_colmap ? &f->choice : NULL, grouped ? task->dir : NULL };
    cn_quality q = { .index = task->index,
                     .scene = &f->posed.scene,
                     .frame = &f->posed.frame,
                     .control = f->fit.n_points ? &f->control : NULL,
                     .fit = &f->fit,
                     .source = by_colmap ? "COLMAP" : task->options->import,
                     .import = task->options->import,
                     .verdict = f->posed.import,
                     .way = f->choice.way,
                     .attempt = f->choice.attempt,
                     .grouped = grouped ? &f->grouped : NULL,
                     .n_models = f->posed.n_models };
    char *json = cn_path_join(task->dir, "report.json"), *page = cn_path_join(task->dir, "report.html");
    cn_status status = json && page ? cn_quality_measure(&how, &q) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_quality_save_json(&q, json);
    if (status == CN_OK) status = cn_quality_save_page(&q, page);
    if (status == CN_OK) cn_log(task->ctx, CN_LOG_INFO, "how good the poses are: %s", page);
    cn_quality_deinit(&q);
    free(json);
    free(page);
    return status;
}

/* poses.json is written last: when it exists, everything else is complete. Old files stay until the large files are
 * written. */
static cn_status save_all(const cn_colmap_task *task, const found *f, const cn_pose_report *report,
                          const char *frame_path)
{
    const char *dir = task->dir;
    char *model = cn_path_join(dir, "model"), *fresh = cn_path_join(dir, "model-new");
    char *done = cn_path_join(dir, "poses.json");
    cn_status status = model && fresh && done ? CN_OK : cn_fail(CN_ERR_NOMEM, "%s: out of memory", dir);
    if (status == CN_OK) status = cn_folder_remove(fresh);
    if (status == CN_OK) status = cn_scene_write_colmap(&f->posed.scene, fresh);
    if (status == CN_OK) status = swap_model(fresh, model, done);
    if (status == CN_OK) status = cn_frame_save(&f->posed.frame, frame_path);
    if (status == CN_OK) status = save_quality(task, f);
    if (status == CN_OK) status = save_report(report, &f->posed.frame, done);
    free(model);
    free(fresh);
    free(done);
    return status;
}

static cn_status merge_groups(const cn_colmap_task *task, const cn_pose_work *work, found *f)
{
    f->posed.n_models = 1;
    return cn_grouped_merge(task->ctx, work, &f->posed.scene, &f->posed.frame, &f->grouped);
}

/* work NULL: the photos are not in groups. */
static cn_status find_and_save(const cn_colmap_task *task, const cn_pose_work *work, const char *frame_path, found *f,
                               cn_pose_report *report)
{
    cn_posed *posed = &f->posed;
    cn_status status = work ? merge_groups(task, work, f)
                       : task->options->import
                           ? run_import(task, posed)
                           : cn_pose_from_photos(task, &posed->scene, &posed->frame, &posed->n_models);
    if (status == CN_OK) status = apply_control(task, &f->control, posed, &f->fit);
    if (status == CN_OK) status = make_report(&posed->scene, task->index, posed->n_models, report);
    if (status != CN_OK) return status;
    report->n_control = f->fit.n_control;
    report->n_check = f->fit.n_check;
    report->control_rms_m = f->fit.n_control ? length(f->fit.control_rms_m) : NAN;
    report->check_rms_m = f->fit.n_check ? length(f->fit.check_rms_m) : NAN;
    return save_all(task, f, report, frame_path);
}

static cn_status run(const cn_context *ctx, const cn_pose_work *how, bool grouped, const char *frame_path,
                     cn_pose_report *report)
{
    found f = { 0 };
    const cn_photo_index *index = how->index;
    const cn_pose_options *options = how->options;
    const cn_colmap_task task = {
        .ctx = ctx, .index = index, .dir = how->dir, .options = options, .choice = &f.choice
    };
    memset(report, 0, sizeof *report);
    if (index->n_photos == 0)
        return cn_fail(CN_ERR_DATA, "%s holds no photo that can be used", index->folder ? index->folder : "the folder");
    CN_TRY(cn_folder_make(how->dir));
    if (options->control) {
        const cn_control_source source = { index, options->control, options->check,
                                           options->control_heights == CN_CONTROL_SEA_LEVEL };
        CN_TRY(cn_control_read(ctx, &source, &f.control));
    }
    const cn_status status = find_and_save(&task, grouped ? how : NULL, frame_path, &f, report);
    if (status == CN_OK)
        log_report(ctx, report, &f.posed.scene, &f.posed.frame, options->import || cn_pose_has_focal(index));
    cn_scene_deinit(&f.posed.scene);
    cn_control_deinit(&f.control);
    cn_control_fit_deinit(&f.fit);
    cn_grouped_deinit(&f.grouped);
    free(f.choice.database);
    if (status != CN_OK) cn_pose_report_deinit(report);
    return status;
}

cn_status cn_pose_run(const cn_context *ctx, const cn_photo_index *index, const char *dir, const char *frame_path,
                      const cn_pose_options *options, cn_pose_report *report)
{
    const cn_pose_work how = { index, dir, options, "" };
    return run(ctx, &how, false, frame_path, report);
}

cn_status cn_pose_merge(const cn_context *ctx, const cn_pose_work *work, const char *frame_path, cn_pose_report *report)
{
    return run(ctx, work, true, frame_path, report);
}

static cn_status check_version(const char *dir)
{
    char *path = cn_path_join(dir, "poses.json");
    json_t *root = NULL;
    int64_t version = POSES_VERSION;
    cn_status status = path ? CN_OK : cn_fail(CN_ERR_NOMEM, "%s: out of memory", dir);
    if (status == CN_OK && cn_file_exists(path)) {
        status = cn_json_load(path, &root);
        if (status == CN_OK) status = cn_json_integer(root, path, "version", &version);
    }
    if (status == CN_OK && version > POSES_VERSION)
        status = cn_fail(CN_ERR_VERSION,
                         "%s: version %lld was made by a newer Conurb (this one reads up to %d); "
                         "update Conurb or run conurb poses again",
                         path, (long long)version, POSES_VERSION);
    json_decref(root);
    free(path);
    return status;
}

cn_status cn_pose_load(const cn_context *ctx, const char *dir, const cn_photo_index *index, cn_scene *scene)
{
    memset(scene, 0, sizeof *scene);
    CN_TRY(check_version(dir));
    char *model = cn_path_join(dir, "model");
    if (!model) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", dir);
    cn_status status = cn_scene_read_colmap(scene, model);
    /* Conurb wrote this model: EXIF orientation is applied already. */
    if (status == CN_OK) status = cn_pose_tie(ctx, scene, index, false, model);
    free(model);
    if (status != CN_OK) cn_scene_deinit(scene);
    return status;
}
