#include "conurb/stage.h"
#include "city/lock.h"
#include "city/workspace.h"
#include "stage/pose_groups.h"

#include "base/file.h"
#include "record/record.h"

#include <stdio.h>
#include <stdlib.h>

/* What the poses stage of one call works on. */
typedef struct posing {
    cn_city *city;
    cn_photo_index index;
    char *dir, *frame, key[17];
    cn_pose_work work;
} posing;

static void posing_deinit(posing *p)
{
    cn_photo_index_deinit(&p->index);
    free(p->dir);
    free(p->frame);
}

/* The index as it was when the photos were split: tasks of groups need not read every photo. */
static cn_status load_index(posing *p)
{
    char *path = cn_city_path(p->city, "poses/groups/photos.json");
    cn_status status = path ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK && !cn_file_exists(path))
        status = cn_fail(CN_ERR_DATA, "%s has no groups; run `conurb poses %s --split` first", p->city->folder,
                         p->city->folder);
    if (status == CN_OK) status = cn_photo_index_load(&p->index, path);
    free(path);
    return status;
}

static cn_status posing_init(posing *p, const cn_context *ctx, cn_city *city, bool split_before)
{
    *p = (posing){ .city = city };
    cn_status status = split_before ? load_index(p) : cn_photo_index_scan(ctx, city->config.photos, &p->index);
    if (status == CN_OK) {
        p->dir = cn_city_path(city, "poses");
        p->frame = cn_city_path(city, "frame.json");
        cn_stage_groups_key(city, &p->index, p->key);
        p->work = (cn_pose_work){ &p->index, p->dir, &city->config.poses, p->key };
        if (!p->dir || !p->frame) status = cn_fail(CN_ERR_NOMEM, "out of memory");
    }
    if (status != CN_OK) posing_deinit(p);
    return status;
}

/* Poses of all photos, or of the groups together. */
static cn_status make_poses(const cn_context *ctx, const posing *p, bool grouped)
{
    cn_pose_report report = { 0 };
    cn_stage stage;
    cn_status status = cn_folder_make(p->dir);
    if (status == CN_OK)
        status = grouped ? cn_pose_merge(ctx, &p->work, p->frame, &report)
                         : cn_pose_run(ctx, &p->index, p->dir, p->frame, &p->city->config.poses, &report);
    /* What became of the groups is a part of the identity. */
    if (status == CN_OK) status = cn_stage_poses(p->city, &p->index, &stage);
    if (status == CN_OK) status = cn_stage_finish(p->city, &stage);
    cn_pose_report_deinit(&report);
    return status;
}

static cn_status is_done(const posing *p, bool *done)
{
    cn_stage stage;
    CN_TRY(cn_stage_poses(p->city, &p->index, &stage));
    *done = cn_stage_done(p->city, &stage, NULL);
    return CN_OK;
}

/* Under the lock of the poses. */
static cn_status pose_alone(const cn_context *ctx, const posing *p, bool grouped)
{
    cn_city_lock lock;
    bool done = false;
    CN_TRY(cn_city_lock_take(&lock, ctx, p->city, "poses", "the poses"));
    cn_status status = cn_folder_sweep(p->city->folder, "frame", 0);
    /* Another process may have made them in between. */
    if (status == CN_OK) status = is_done(p, &done);
    if (status == CN_OK && !done) status = make_poses(&lock.ctx, p, grouped);
    cn_city_lock_drop(&lock);
    return status;
}

static cn_status split(const cn_context *ctx, const posing *p, uint32_t *n_groups)
{
    cn_city_lock lock;
    CN_TRY(cn_city_lock_take(&lock, ctx, p->city, "poses", "the poses"));
    const cn_status status = cn_pose_split(&lock.ctx, &p->work, n_groups);
    cn_city_lock_drop(&lock);
    return status;
}

/* The groups are mapped without the lock of the poses, so that other processes can map some of them. */
static cn_status pose_groups(const cn_context *ctx, const posing *p)
{
    uint32_t n_groups;
    CN_TRY(split(ctx, p, &n_groups));
    CN_TRY(cn_pose_groups_map(ctx, p->city, &p->work, n_groups));
    return pose_alone(ctx, p, true);
}

/* The index is saved only when its poses are done, so that a failure does not change the city. */
static cn_status save_index(const posing *p)
{
    char *path = cn_city_path(p->city, "photos.json");
    const cn_status status = path ? cn_photo_index_save(&p->index, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    return status;
}

static cn_status pose(const cn_context *ctx, const posing *p, bool only_merge)
{
    bool done = false;
    const bool grouped = cn_pose_is_grouped(&p->index, &p->city->config.poses);
    CN_TRY(is_done(p, &done));
    if (done) {
        cn_city_lock_tidy(p->city, "poses");
        cn_log(ctx, CN_LOG_INFO, "poses are done");
    } else {
        CN_TRY(!grouped ? pose_alone(ctx, p, false) : only_merge ? pose_alone(ctx, p, true) : pose_groups(ctx, p));
    }
    return save_index(p);
}

cn_status cn_city_poses(const cn_context *ctx, cn_city *city)
{
    posing p;
    CN_TRY(posing_init(&p, ctx, city, false));
    const cn_status status = pose(ctx, &p, false);
    posing_deinit(&p);
    return status;
}

cn_status cn_city_poses_merge(const cn_context *ctx, cn_city *city)
{
    posing p;
    CN_TRY(posing_init(&p, ctx, city, true));
    const cn_status status = pose(ctx, &p, true);
    posing_deinit(&p);
    return status;
}

/* Groups of earlier settings would be taken for those of a city that has none. */
static cn_status remove_groups(const cn_city *city)
{
    char *path = cn_city_path(city, "poses/groups/groups.json");
    const cn_status status = path ? cn_file_remove(path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    return status;
}

cn_status cn_city_poses_split(const cn_context *ctx, cn_city *city)
{
    posing p;
    uint32_t n_groups;
    CN_TRY(posing_init(&p, ctx, city, false));
    cn_status status;
    if (cn_pose_is_grouped(&p.index, &city->config.poses)) {
        status = split(ctx, &p, &n_groups);
    } else {
        status = remove_groups(city);
        cn_log(ctx, CN_LOG_INFO, "%u photos need no groups: conurb poses poses them at once", p.index.n_photos);
    }
    posing_deinit(&p);
    return status;
}

cn_status cn_city_poses_group(const cn_context *ctx, cn_city *city, uint32_t group)
{
    posing p;
    CN_TRY(posing_init(&p, ctx, city, true));
    const cn_status status = cn_pose_groups_map_one(ctx, city, &p.work, group);
    posing_deinit(&p);
    return status;
}
