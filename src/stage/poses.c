#include "conurb/stage.h"
#include "city/lock.h"
#include "city/workspace.h"

#include "base/file.h"
#include "record/record.h"

#include <stdlib.h>

static cn_status make_poses(const cn_context *ctx, cn_city *city, const cn_photo_index *index, const cn_stage *stage)
{
    char *dir = cn_city_path(city, "poses"), *frame = cn_city_path(city, "frame.json");
    cn_pose_report report = { 0 };
    cn_status status = dir && frame ? cn_folder_make(dir) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_pose_run(ctx, index, dir, frame, &city->config.poses, &report);
    if (status == CN_OK) status = cn_stage_finish(city, stage);
    cn_pose_report_deinit(&report);
    free(dir);
    free(frame);
    return status;
}

static cn_status pose(const cn_context *ctx, cn_city *city, const cn_photo_index *index)
{
    cn_stage stage;
    cn_city_lock lock;
    CN_TRY(cn_stage_poses(city, index, &stage));
    if (!cn_stage_done(city, &stage, NULL)) {
        CN_TRY(cn_city_lock_take(&lock, ctx, city, "poses", "the poses"));
        cn_status status = cn_folder_sweep(city->folder, "frame", 0);
        /* Another process may have made them in between. */
        const bool done = cn_stage_done(city, &stage, NULL);
        if (status == CN_OK && !done) status = make_poses(&lock.ctx, city, index, &stage);
        cn_city_lock_drop(&lock);
        if (status != CN_OK || !done) return status;
    }
    cn_city_lock_tidy(city, "poses");
    cn_log(ctx, CN_LOG_INFO, "poses are done");
    return CN_OK;
}

cn_status cn_city_poses(const cn_context *ctx, cn_city *city)
{
    cn_photo_index index;
    CN_TRY(cn_photo_index_scan(ctx, city->config.photos, &index));
    /* The index is saved only when its poses are done, so that a failure does not change the city. */
    char *path = cn_city_path(city, "photos.json");
    cn_status status = path ? pose(ctx, city, &index) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_photo_index_save(&index, path);
    free(path);
    cn_photo_index_deinit(&index);
    return status;
}
