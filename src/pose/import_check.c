#include "pose/import_check.h"

#include "pose/align_fit.h"
#include "pose/from_photos.h"

#include <stdlib.h>

#define MOST_PHOTOS 200 /* in auto: finding poses anew takes minutes up to here */

static bool is_better(const cn_posed *fresh, const cn_posed *imported)
{
    return fresh->scene.n_views >= imported->scene.n_views && fresh->frame.georeferenced &&
           cn_align_is_clearly_better(imported->frame.n_gps, imported->frame.n_inliers, fresh->frame.n_inliers);
}

static cn_status find_anew(const cn_colmap_task *task, cn_posed *posed)
{
    cn_posed fresh = { 0 };
    bool used = false;
    cn_status status = cn_pose_from_photos(task, &fresh.scene, &fresh.frame, &fresh.n_models);
    if (status == CN_ERR_TOOL || status == CN_ERR_DATA) {
        cn_log(task->ctx, CN_LOG_WARN, "the imported poses are kept, because no others were found: %s",
               cn_error_message());
        status = CN_OK;
    } else if (status == CN_OK && is_better(&fresh, posed)) {
        cn_log(task->ctx, CN_LOG_WARN,
               "the poses found anew are used: %u of %u photos agree with their GPS, with the imported poses %u of %u "
               "(poses.check_import: off keeps the import)",
               fresh.frame.n_inliers, fresh.frame.n_gps, posed->frame.n_inliers, posed->frame.n_gps);
        const cn_posed old = *posed;
        posed->import.n_agree_anew = fresh.frame.n_inliers;
        posed->import.outcome = CN_IMPORT_REPLACED;
        fresh.import = posed->import;
        *posed = fresh;
        fresh = old;
        used = true;
    } else if (status == CN_OK) {
        cn_log(task->ctx, CN_LOG_INFO,
               "the imported poses are kept: found anew, %u photos have a pose and %u agree with their GPS",
               fresh.scene.n_views, fresh.frame.n_inliers);
        posed->import.outcome = CN_IMPORT_KEPT;
        posed->import.n_agree_anew = fresh.frame.n_inliers;
    }
    if (!used && task->choice) {
        free(task->choice->database);
        *task->choice = (cn_colmap_choice){ 0 };
    }
    cn_scene_deinit(&fresh.scene);
    return status;
}

cn_status cn_import_check(const cn_colmap_task *task, cn_posed *posed)
{
    const cn_pose_options *options = task->options;
    const cn_frame *frame = &posed->frame;
    posed->import = (cn_import_verdict){ .n_gps = frame->n_gps, .n_agree = frame->n_inliers };
    if (options->check_import == CN_OFF || !frame->georeferenced || !frame->n_gps) return CN_OK;
    posed->import.outcome = CN_IMPORT_AGREES;
    if (!cn_align_is_doubtful(frame->n_gps, frame->n_inliers)) return CN_OK;
    posed->import.outcome = CN_IMPORT_DOUBTFUL;
    cn_log(task->ctx, CN_LOG_WARN,
           "%s: %u of %u photos are more than %g m from their GPS; these poses bend, or parts of them are joined "
           "wrongly",
           options->import, frame->n_gps - frame->n_inliers, frame->n_gps, options->max_error_m);
    if (options->check_import == CN_AUTO && task->index->n_photos > MOST_PHOTOS) {
        cn_log(task->ctx, CN_LOG_WARN, "poses.check_import: on finds the poses of these %u photos anew",
               task->index->n_photos);
        return CN_OK;
    }
    cn_log(task->ctx, CN_LOG_INFO, "finding the poses anew from the photos, for comparison");
    return find_anew(task, posed);
}
