#include "pose/mapping.h"

#include "base/file.h"
#include "base/process.h"
#include "bridge/sqlite.h"
#include "math/linalg.h"
#include "pose/colmap.h"
#include "pose/global.h"
#include "pose/lens.h"
#include "pose/outlier.h"
#include "pose/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Pixels of cameras are square. Photos along a line leave the two focal lengths undetermined. */
#define MOST_SKEWED 1.03

/* All photos are adjusted together when there are 40 % more of them, not 10 %. The last adjustment stays as it is.
 * Measured on castle, herz-jesus, brighton and lund: see tests/bench/README.md. */
#define FEWER_GLOBAL_ADJUSTMENTS                                                                                       \
    "--Mapper.ba_global_images_ratio", "1.4", "--Mapper.ba_global_points_ratio", "1.4",                                \
        "--Mapper.ba_global_max_num_iterations", "25", "--Mapper.ba_global_max_refinements", "2",                      \
        "--Mapper.ba_local_max_refinements", "1"

/* One program of COLMAP, whose model goes to a folder that is made anew. */
static cn_status run_to(cn_colmap_job *j, const char *const *argv, const char *output, int *exit_code)
{
    CN_TRY(cn_folder_remove(output));
    CN_TRY(cn_folder_make(output));
    return cn_job_run(j, argv, exit_code);
}

typedef struct mapper_run {
    const char *from, *to; /* folders; from: the model to go on with, or NULL */
    bool fix_focal;
} mapper_run;

/* *none: COLMAP ran to its end and says that there is no model. */
static cn_status run_mapper(cn_colmap_job *j, const mapper_run *run, bool *none)
{
    const char *const base[] = { j->options->colmap,
                                 "mapper",
                                 "--database_path",
                                 j->database,
                                 "--image_path",
                                 j->images,
                                 "--output_path",
                                 run->to,
                                 "--Mapper.num_threads",
                                 j->threads,
                                 "--Mapper.ba_refine_focal_length",
                                 run->fix_focal ? "0" : "1",
                                 "--Mapper.ba_refine_principal_point",
                                 "0",
                                 FEWER_GLOBAL_ADJUSTMENTS,
                                 NULL };
    const char *const more[] = { "--input_path", run->from, NULL };
    const char *argv[CN_JOB_WORDS];
    int n = 0, exit_code;
    cn_job_words(argv, &n, base);
    if (run->from) cn_job_words(argv, &n, more);
    cn_job_words(argv, &n, j->way->mapper);
    CN_TRY(run_to(j, argv, run->to, &exit_code));
    *none = exit_code == 0 || strstr(j->last, "failed to create sparse model");
    /* Other exit codes may also mean that there is no model; the caller looks for one. */
    return exit_code > 128 ? cn_job_failed(j, exit_code) : CN_OK;
}

static void hear_global(void *user, char *line)
{
    bool *found = user;
    *found = *found || strstr(line, "global_mapper");
}

/* False also when the program cannot be run: the next step then says so. */
bool cn_colmap_has_global_mapper(const char *colmap)
{
    const char *const argv[] = { colmap, "help", NULL };
    bool found = false;
    int exit_code;
    return cn_process_run(NULL, argv, "/dev/null", hear_global, &found, &exit_code) == CN_OK && found;
}

static cn_status run_colmaps_global(cn_colmap_job *j, const char *sparse)
{
    const char *const argv[] = { j->options->colmap, "global_mapper", "--database_path",
                                 j->database,        "--image_path",  j->images,
                                 "--output_path",    sparse,          NULL };
    int exit_code;
    CN_TRY(run_to(j, argv, sparse, &exit_code));
    if (exit_code == 0) return CN_OK;
    cn_log(j->ctx, CN_LOG_WARN, "COLMAP's global mapper gives no model (exit code %d)", exit_code);
    return cn_folder_remove(sparse);
}

/* Folders of the steps that follow Conurb's global mapper. */
typedef struct steps {
    char *placed, *points, *adjusted, *model;
} steps;

/* The photos that were left out may fit once COLMAP knows all points. */
static cn_status add_the_rest(cn_colmap_job *j, const steps *s, bool fix_focal)
{
    bool none;
    CN_TRY(run_mapper(j, &(mapper_run){ s->adjusted, s->model, fix_focal }, &none));
    if (cn_model_photos(s->model) >= cn_model_photos(s->adjusted)) return CN_OK;
    cn_scene scene;
    CN_TRY(cn_scene_read_colmap(&scene, s->adjusted));
    const cn_status status = cn_scene_write_colmap(&scene, s->model);
    cn_scene_deinit(&scene);
    return status;
}

/* Conurb placed the cameras; COLMAP finds all points, and adjusts. Nothing is left in s->model where that fails. */
static cn_status finish_global(cn_colmap_job *j, const cn_scene *scene, const steps *s, bool fix_focal)
{
    const bool whole = scene->n_views == j->index->n_photos;
    const char *adjusted = whole ? s->model : s->adjusted;
    const char *const triangulate[] = { j->options->colmap,
                                        "point_triangulator",
                                        "--database_path",
                                        j->database,
                                        "--image_path",
                                        j->images,
                                        "--input_path",
                                        s->placed,
                                        "--output_path",
                                        s->points,
                                        "--clear_points",
                                        "1",
                                        NULL };
    const char *const adjust[] = { j->options->colmap,
                                   "bundle_adjuster",
                                   "--input_path",
                                   s->points,
                                   "--output_path",
                                   adjusted,
                                   "--BundleAdjustment.refine_focal_length",
                                   fix_focal ? "0" : "1",
                                   NULL };
    int exit_code;
    CN_TRY(cn_folder_remove(s->placed));
    CN_TRY(cn_scene_write_colmap(scene, s->placed));
    CN_TRY(run_to(j, triangulate, s->points, &exit_code));
    if (exit_code == 0) CN_TRY(run_to(j, adjust, adjusted, &exit_code));
    if (exit_code) {
        cn_log(j->ctx, CN_LOG_WARN, "COLMAP does not go on from poses that were found at once: %s; see %s", j->last,
               j->log);
        return cn_folder_remove(adjusted);
    }
    return whole ? CN_OK : add_the_rest(j, s, fix_focal);
}

static cn_status run_own_global(cn_colmap_job *j, const char *sparse, bool fix_focal)
{
    const steps s = { cn_format("%s-placed", sparse), cn_format("%s-points", sparse), cn_format("%s-adjusted", sparse),
                      cn_path_join(sparse, "0") };
    const cn_global_task task = { j->ctx, j->index, j->database, j->linked, fix_focal };
    cn_scene scene = { 0 };
    cn_status status = s.placed && s.points && s.adjusted && s.model ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_global_map(&task, &scene);
    if (status == CN_OK && scene.n_views) status = finish_global(j, &scene, &s, fix_focal);
    cn_scene_deinit(&scene);
    free(s.placed);
    free(s.points);
    free(s.adjusted);
    free(s.model);
    return status;
}

/* What this way cannot do is no failure: COLMAP then maps one photo after the other. */
static cn_status map_at_once(cn_colmap_job *j, const cn_mapping *how, const char *sparse, cn_mapped *out)
{
    if (cn_job_is_done(j)) CN_TRY(cn_colmap_find_model(sparse, &out->model, &out->n_models));
    if (out->model) return CN_OK;
    CN_TRY(cn_job_unmark(j));
    CN_TRY(cn_folder_remove(sparse));
    CN_TRY(how->global == CN_GLOBAL_COLMAP ? run_colmaps_global(j, sparse) : run_own_global(j, sparse, how->fix_focal));
    CN_TRY(cn_colmap_find_model(sparse, &out->model, &out->n_models));
    return out->model ? cn_job_mark_done(j) : CN_OK;
}

static cn_status map_and_choose(cn_colmap_job *j, const cn_mapping *how, const char *sparse, cn_mapped *out)
{
    bool none = false;
    const bool done = cn_job_is_done(j);
    char *mark = done ? cn_path_join(sparse, "none") : NULL;
    const bool nothing = mark && cn_file_exists(mark);
    free(mark);
    if (nothing) return CN_OK;
    if (done) CN_TRY(cn_colmap_find_model(sparse, &out->model, &out->n_models));
    if (out->model) return CN_OK;
    CN_TRY(cn_job_unmark(j));
    CN_TRY(run_mapper(j, &(mapper_run){ NULL, sparse, how->fix_focal }, &none));
    CN_TRY(cn_colmap_find_model(sparse, &out->model, &out->n_models));
    if (out->model) return cn_job_mark_done(j);
    if (!none) return CN_OK;
    /* The same matches would give nothing again. */
    mark = cn_path_join(sparse, "none");
    cn_status status = mark ? cn_file_write(mark, "", 0) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(mark);
    return status == CN_OK ? cn_job_mark_done(j) : status;
}

static cn_status count_placed(const char *sparse, cn_mapped *out)
{
    char *placed = cn_format("%s-placed", sparse);
    if (!placed) return cn_fail(CN_ERR_NOMEM, "out of memory");
    out->n_at_once = cn_model_photos(placed);
    free(placed);
    return CN_OK;
}

static cn_status stage_mapping(cn_colmap_job *j, const cn_mapping *how, cn_mapped *out)
{
    char *stage = cn_format("mapping%s%s", how->fix_focal ? "-fixed-focal" : "", how->suffix);
    char *sparse = cn_format("%s/sparse%s%s", j->dir, how->fix_focal ? "-fixed-focal" : "", how->suffix);
    cn_status status = stage && sparse ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) {
        cn_job_begin(j, stage, j->index->n_photos);
        cn_job_mix(j, stage, strlen(stage));
        cn_job_mix_words(j, j->way->mapper);
        cn_job_mix(j, &j->way->simple_camera, sizeof j->way->simple_camera);
        cn_job_mix(j, &how->global, sizeof how->global);
        status = how->global ? map_at_once(j, how, sparse, out) : map_and_choose(j, how, sparse, out);
        if (status == CN_OK && out->model && how->global == CN_GLOBAL_OWN) status = count_placed(sparse, out);
        j->stage = "mapping";
    }
    free(stage);
    if (status == CN_OK && out->model)
        out->folder = sparse;
    else
        free(sparse);
    return status;
}

/* OPENCV with its tangential terms bends a straight-down block of photos into a bowl. True when a camera was replaced.
 */
static bool simplify_lenses(cn_scene *scene, bool keep_focal)
{
    bool changed = false;
    for (uint32_t i = 0; i < scene->n_cameras; i++) {
        cn_camera *camera = &scene->cameras[i];
        if (camera->lens != CN_LENS_OPENCV) continue;
        const cn_lens_view full = cn_lens_unpack(camera);
        const double focal = keep_focal ? full.fx : sqrt(full.fx * full.fy);
        const cn_lens_view simple = { .fx = focal, .fy = focal, .cx = full.cx, .cy = full.cy, .k = { full.k[0] } };
        camera->lens = CN_LENS_SIMPLE_RADIAL;
        cn_lens_pack(&simple, camera);
        changed = true;
    }
    return changed;
}

static cn_status adjust(cn_colmap_job *j, const char *input, const char *output, bool keep_focal)
{
    int exit_code;
    const char *const argv[] = { j->options->colmap,
                                 "bundle_adjuster",
                                 "--input_path",
                                 input,
                                 "--output_path",
                                 output,
                                 "--BundleAdjustment.refine_focal_length",
                                 keep_focal ? "0" : "1",
                                 "--BundleAdjustment.max_num_iterations",
                                 "200",
                                 NULL };
    CN_TRY(cn_job_unmark(j));
    CN_TRY(run_to(j, argv, output, &exit_code));
    return exit_code ? cn_job_failed(j, exit_code) : cn_job_mark_done(j);
}

typedef struct adjustment {
    const char *name, *suffix; /* of its folder */
    bool keep_focal;
} adjustment;

static cn_status adjust_simple(cn_colmap_job *j, const adjustment *how, cn_scene *scene, char **model)
{
    char *input = cn_format("%s/sparse-%s%s-start", j->dir, how->name, how->suffix);
    char *output = cn_format("%s/sparse-%s%s", j->dir, how->name, how->suffix);
    cn_status status = input && output ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && !(cn_job_is_done(j) && cn_model_photos(output))) {
        status = cn_scene_write_colmap(scene, input);
        if (status == CN_OK) status = adjust(j, input, output, how->keep_focal);
    }
    free(input);
    if (status != CN_OK) {
        free(output);
        return status;
    }
    free(*model);
    *model = output;
    return CN_OK;
}

static cn_status stage_one_focal(cn_colmap_job *j, const char *suffix, char **model)
{
    const adjustment how = { "one-focal", suffix, false };
    cn_scene scene;
    char *stage = cn_format("mapping-%s%s", how.name, suffix);
    if (!stage) return cn_fail(CN_ERR_NOMEM, "out of memory");
    cn_job_begin(j, stage, 0.0);
    cn_job_mix(j, stage, strlen(stage));
    cn_status status = cn_scene_read_colmap(&scene, *model);
    if (status == CN_OK && simplify_lenses(&scene, false)) status = adjust_simple(j, &how, &scene, model);
    cn_scene_deinit(&scene);
    j->stage = "mapping";
    free(stage);
    return status;
}

/* depths: of the points that each view sees, view after view; view v begins at first[v]. */
static void list_depths(const cn_scene *scene, const uint64_t *first, uint64_t *n, double *depths)
{
    for (uint32_t i = 0; i < scene->n_points; i++) {
        const cn_point *point = &scene->points[i];
        for (uint32_t k = 0; k < point->n_observations; k++) {
            const uint32_t v = scene->observations[point->first_observation + k].view;
            const cn_view *view = &scene->views[v];
            double z = view->translation[2];
            for (int c = 0; c < 3; c++)
                z += view->rotation[6 + c] * point->xyz[c];
            depths[first[v] + n[v]++] = z;
        }
    }
}

/* Moves each view back along its axis, by its median depth times ratio[camera] - 1: what it sees keeps its size. */
static cn_status step_back(cn_scene *scene, const double *ratio)
{
    uint64_t *first = calloc(2 * ((size_t)scene->n_views + 1), sizeof *first), *n = first + scene->n_views + 1;
    double *depths = malloc((scene->n_observations + (size_t)1) * sizeof *depths);
    if (!first || !depths) {
        free(first);
        free(depths);
        return cn_fail(CN_ERR_NOMEM, "out of memory");
    }
    for (uint64_t i = 0; i < scene->n_observations; i++)
        first[scene->observations[i].view + 1]++;
    for (uint32_t v = 0; v < scene->n_views; v++)
        first[v + 1] += first[v];
    list_depths(scene, first, n, depths);
    for (uint32_t v = 0; v < scene->n_views; v++) {
        if (!n[v]) continue;
        const double depth = cn_select(depths + first[v], n[v], n[v] / 2);
        scene->views[v].translation[2] += depth * (ratio[scene->views[v].camera] - 1.0);
    }
    free(first);
    free(depths);
    return CN_OK;
}

/* Gives the cameras the focal lengths of the database. ratio[i]: the new focal length of camera i over the old one. */
static cn_status restore_focals(const cn_colmap_job *j, cn_scene *scene, double *ratio)
{
    cn_colmap_database *database;
    CN_TRY(cn_colmap_database_open(&database, j->database));
    cn_status status = CN_OK;
    for (uint32_t i = 0; i < scene->n_cameras; i++)
        ratio[i] = 0.0;
    for (uint32_t i = 0; i < scene->n_views && status == CN_OK; i++) {
        const uint32_t k = scene->views[i].camera;
        cn_colmap_camera given;
        uint32_t id;
        if (ratio[k] > 0.0) continue;
        status = cn_colmap_database_camera(database, scene->views[i].name, &id);
        if (status == CN_OK) status = cn_colmap_database_lens(database, id, &given);
        if (status != CN_OK) break;
        cn_lens_view lens = cn_lens_unpack(&scene->cameras[k]);
        ratio[k] = given.params[0] / sqrt(lens.fx * lens.fy);
        lens.fx = lens.fy = given.params[0];
        cn_lens_pack(&lens, &scene->cameras[k]);
    }
    cn_colmap_database_close(&database);
    return status;
}

/* The model's bytes are what this stage is made from. */
static cn_status mix_model(cn_colmap_job *j, const char *model)
{
    char *path = cn_path_join(model, "images.bin"), *data;
    size_t size;
    const cn_status status = path ? cn_file_read(path, 0, &data, &size) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    CN_TRY(status);
    cn_job_mix(j, data, size);
    free(data);
    return CN_OK;
}

/* Adjusts with the focal lengths of EXIF. simple: with one radial term, which cannot bend the ground; else with the
 * terms that the lens has. */
static cn_status adjust_given_focal(cn_colmap_job *j, const char *from, bool simple, char **model, double *error_px)
{
    const adjustment how = { simple ? "simple-lens" : "given-focal", "", true };
    cn_scene scene = { 0 };
    double *ratio = NULL;
    *model = NULL;
    cn_job_begin(j, simple ? "mapping-simple-lens" : "mapping-given-focal", 0.0);
    cn_status status = mix_model(j, from);
    if (status == CN_OK) status = cn_scene_read_colmap(&scene, from);
    if (status == CN_OK) ratio = malloc((scene.n_cameras + (size_t)1) * sizeof *ratio);
    if (status == CN_OK && !ratio) status = cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = restore_focals(j, &scene, ratio);
    if (status == CN_OK) status = step_back(&scene, ratio);
    if (status == CN_OK && simple) simplify_lenses(&scene, true);
    if (status == CN_OK) status = adjust_simple(j, &how, &scene, model);
    cn_scene_deinit(&scene);
    free(ratio);
    CN_TRY(status);
    status = cn_scene_read_colmap(&scene, *model);
    if (status != CN_OK) {
        free(*model);
        *model = NULL;
        return status;
    }
    *error_px = cn_scene_measure_errors(&scene);
    cn_scene_deinit(&scene);
    return CN_OK;
}

/* When the focal length is given, one radial term is enough for most lenses: brighton's errors are 0.48 px with it and
 * 0.43 px with three terms more. Where it leaves much larger errors, the lens has these terms: a flight with 1.49 and
 * 1.15 px gains 0.6 dB (half-photo PSNR) by them. Found on these two. */
#define MUCH_MORE 1.2
cn_status cn_colmap_settle_focal(cn_colmap_job *j, const char *from, char **model)
{
    double simple_px, full_px;
    char *full = NULL;
    CN_TRY(adjust_given_focal(j, from, true, model, &simple_px));
    const cn_status status = adjust_given_focal(j, from, false, &full, &full_px);
    if (status != CN_OK) {
        free(*model);
        *model = NULL;
    }
    CN_TRY(status);
    if (simple_px <= MUCH_MORE * full_px) {
        free(full);
        return CN_OK;
    }
    cn_log(j->ctx, CN_LOG_INFO,
           "a simple lens leaves errors of %.2f px, the lens with all its terms %.2f px, so that one is kept",
           simple_px, full_px);
    free(*model);
    *model = full;
    return CN_OK;
}

/* The camera whose two focal lengths differ most; its ratio is above 1. */
static double most_skewed(const cn_scene *scene, cn_lens_view *lens)
{
    double most = 1.0;
    for (uint32_t i = 0; i < scene->n_cameras; i++) {
        const cn_lens_view view = cn_lens_unpack(&scene->cameras[i]);
        const double ratio = fmax(view.fx / view.fy, view.fy / view.fx);
        if (ratio <= most) continue;
        most = ratio;
        *lens = view;
    }
    return most;
}

void cn_mapped_deinit(cn_mapped *mapped)
{
    free(mapped->model);
    free(mapped->folder);
    *mapped = (cn_mapped){ 0 };
}

static cn_status measure(cn_mapped *out, double *skewed, cn_lens_view *lens)
{
    cn_scene scene;
    CN_TRY(cn_scene_read_colmap(&scene, out->model));
    *skewed = most_skewed(&scene, lens);
    const cn_status status = cn_pose_drop_unsupported(NULL, &scene);
    out->n_photos = scene.n_views;
    out->n_points = scene.n_points;
    out->error_px = cn_scene_measure_errors(&scene);
    cn_scene_deinit(&scene);
    return status;
}

static cn_status map_and_adjust(cn_colmap_job *j, const cn_mapping *how, cn_mapped *out)
{
    double skewed;
    cn_lens_view lens = { 0 };
    CN_TRY(stage_mapping(j, how, out));
    if (!out->model) return CN_OK;
    CN_TRY(measure(out, &skewed, &lens));
    if (skewed <= MOST_SKEWED) return CN_OK;
    cn_log(j->ctx, CN_LOG_INFO,
           "COLMAP's focal lengths %.0f across and %.0f down are those of no lens: adjusting with one focal length",
           lens.fx, lens.fy);
    CN_TRY(stage_one_focal(j, how->suffix, &out->model));
    return measure(out, &skewed, &lens);
}

cn_status cn_colmap_map(cn_colmap_job *j, const cn_mapping *how, cn_mapped *out)
{
    memset(out, 0, sizeof *out);
    const cn_status status = map_and_adjust(j, how, out);
    if (status != CN_OK) cn_mapped_deinit(out);
    return status;
}
