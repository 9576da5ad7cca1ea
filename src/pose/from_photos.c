/* Poses from the photos alone: COLMAP's, aligned to GPS. */
#include "pose/from_photos.h"

#include "pose/align.h"
#include "pose/colmap.h"
#include "pose/panorama.h"
#include "pose/parts.h"
#include "pose/result.h"
#include "pose/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define EVERY_PAIR 60 /* photos of all directions, without GPS, at most of which every pair is matched */

bool cn_pose_has_focal(const cn_photo_index *index)
{
    for (uint32_t i = 0; i < index->n_photos; i++)
        if (isfinite(index->photos[i].focal_mm) || isfinite(index->photos[i].focal_35mm)) return true;
    return false;
}

bool cn_pose_keeps_focal(const cn_photo_index *index, cn_tristate refine_focal, bool nadir)
{
    return refine_focal == CN_OFF || (refine_focal == CN_AUTO && nadir && cn_pose_has_focal(index));
}

static cn_status read_aligned(const cn_colmap_task *task, const char *model, cn_scene *scene, cn_frame *frame)
{
    CN_TRY(cn_pose_read_result(task->ctx, task->index, model, scene));
    return cn_align(task->ctx, scene, task->index, task->options->max_error_m, CN_LEVEL_ALWAYS, frame);
}

/* Each view is core where its photo is; *out is NULL without a core. The caller frees it. */
static cn_status core_of_views(const bool *core, const cn_panorama_cut *cut, bool **out)
{
    *out = core ? malloc(cut->index.n_photos + (size_t)1) : NULL;
    if (core && !*out) return cn_fail(CN_ERR_NOMEM, "out of memory for views of 360 degree photos");
    for (uint32_t i = 0; core && i < cut->index.n_photos; i++)
        (*out)[i] = core[cut->photo[i]];
    return CN_OK;
}

/* Photos of all directions, and others among them: COLMAP poses their views. */
static cn_status pose_panoramas(const cn_colmap_task *task, cn_scene *scene, cn_frame *frame, uint32_t *n_models)
{
    cn_panorama_cut cut;
    cn_colmap_result result = { 0 };
    cn_scene pieces = { 0 };
    bool *core = NULL;
    cn_status status = cn_panorama_cut_make(task->ctx, task->index, task->dir, &cut);
    if (status == CN_OK) status = core_of_views(task->core, &cut, &core);
    if (status == CN_OK) {
        cn_pose_options options = *task->options;
        cn_colmap_task pass = *task;
        pass.index = &cut.index;
        pass.options = &options;
        pass.core = core;
        pass.rig_views = true;
        pass.fix_focal = options.refine_focal == CN_OFF || cut.n_panoramas == task->index->n_photos;
        /* Neighbours of a photo become neighbours of each of its views, beside those of the same place. */
        options.neighbours = (options.neighbours + 1) * CN_PANORAMA_VIEWS;
        if (options.matcher == CN_MATCH_AUTO && !task->index->n_gps && task->index->n_photos <= EVERY_PAIR)
            options.matcher = CN_MATCH_EXHAUSTIVE;
        cn_log(task->ctx, CN_LOG_INFO, "%u of %u photos show all directions: COLMAP poses %u views of each",
               cut.n_panoramas, task->index->n_photos, CN_PANORAMA_VIEWS);
        status = cn_colmap_poses(&pass, &result);
        if (status == CN_OK) status = cn_pose_read_result(task->ctx, &cut.index, result.model, &pieces);
        const bool keep_focal = options.refine_focal == CN_OFF;
        if (status == CN_OK) status = cn_panorama_join(task->ctx, &cut, task->index, &pieces, keep_focal, scene);
    }
    *n_models = result.n_models;
    /* The database has views, not photos. */
    if (task->choice) {
        free(task->choice->database);
        task->choice->database = NULL;
    }
    cn_scene_deinit(&pieces);
    cn_colmap_result_deinit(&result);
    cn_panorama_cut_deinit(&cut);
    free(core);
    CN_TRY(status);
    return cn_align(task->ctx, scene, task->index, task->options->max_error_m, CN_LEVEL_ALWAYS, frame);
}

/* Adds the parts that GPS places, each of which COLMAP made a model of. */
static cn_status add_parts(const cn_colmap_task *task, const char *folder, cn_scene *scene, const cn_frame *frame,
                           uint32_t *n_models)
{
    cn_parts parts;
    CN_TRY(cn_parts_find(task, folder, scene, frame, &parts));
    cn_status status = CN_OK;
    for (uint32_t i = 0; i < parts.n && status == CN_OK; i++)
        status = cn_scene_append(scene, &parts.scenes[i]);
    if (parts.n && status == CN_OK)
        cn_log(task->ctx, CN_LOG_INFO,
               "%u photos in %u %s that share no matches with the others are placed by their GPS", parts.n_views,
               parts.n, parts.n == 1 ? "part" : "parts");
    *n_models -= parts.n;
    cn_parts_deinit(&parts);
    return status;
}

/* Photos that look straight down on flat ground also fit a longer lens from higher up: then use the focal length of
 * EXIF. */
cn_status cn_pose_from_photos(const cn_colmap_task *task, cn_scene *scene, cn_frame *frame, uint32_t *n_models)
{
    const cn_photo_index *index = task->index;
    const cn_tristate refine = task->options->refine_focal;
    cn_colmap_task pass = *task;
    cn_colmap_result result;
    if (index->n_photos > 1 && cn_panoramas_exist(index)) return pose_panoramas(task, scene, frame, n_models);
    if (index->n_photos < 2)
        return cn_fail(CN_ERR_DATA,
                       "%s holds one photo, but poses need at least two that overlap; add photos, or set "
                       "poses.import",
                       index->folder);
    pass.fix_focal = refine == CN_OFF;
    CN_TRY(cn_colmap_poses(&pass, &result));
    *n_models = result.n_models;
    cn_status status = read_aligned(&pass, result.model, scene, frame);
    if (status == CN_OK && frame->nadir_ambiguous && refine != CN_ON && cn_pose_has_focal(index)) {
        cn_log(task->ctx, CN_LOG_INFO,
               "the photos look straight down: adjusting with the focal length of EXIF and a simple lens");
        cn_scene_deinit(scene);
        status = cn_colmap_settle(&pass, &result);
        if (status == CN_OK) status = read_aligned(&pass, result.model, scene, frame);
    }
    if (status == CN_OK) status = add_parts(&pass, result.folder, scene, frame, n_models);
    cn_colmap_result_deinit(&result);
    return status;
}
