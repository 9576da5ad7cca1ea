#include "appearance/query_image.h"

#include "base/file.h"
#include "city/lock.h"
#include "pose/scene.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

void cn_query_image_deinit(cn_query_image *query)
{
    cn_pixel_store_close(&query->pixels);
    cn_scene_deinit(&query->scene);
}

/* An open store stays valid after its file is removed. */
static cn_status open_pixels(const cn_context *ctx, const cn_photo_index *index, uint32_t width_px, const char *work,
                             cn_pixel_store **pixels)
{
    char *path = cn_path_join(work, "pixels.bin");
    cn_status status = path ? cn_pixel_store_build(ctx, index, width_px, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_pixel_store_open(pixels, path);
    free(path);
    return status;
}

/* Chunks of a render on several machines may need the same photo: they do it one after another. */
static cn_status take_lock(cn_city_lock *lock, const cn_context *ctx, const cn_city *city, const char *dir)
{
    cn_status status;
    while ((status = cn_city_lock_take(lock, ctx, city, dir, "the poses")) == CN_ERR_LOCKED) {
        if (cn_stopping(ctx))
            return cn_fail(
                CN_ERR_INTERRUPTED,
                "stopped while waiting for another process, which makes the poses; run the same command again");
        nanosleep(&(struct timespec){ .tv_sec = 1 }, NULL);
    }
    return status;
}

/* A query photo, and where it is found. */
typedef struct task {
    const char *photo;
    const char *dir;  /* of the city */
    const char *work; /* temporary */
} task;

static cn_status find_in(const cn_context *ctx, const cn_dataset *m, const task *t, cn_query_image *query)
{
    const cn_city *city = m->city;
    cn_city_lock lock;
    cn_photo_index index;
    char *dir = cn_city_path(city, t->dir);
    cn_status status = dir ? take_lock(&lock, ctx, city, t->dir) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) {
        status = cn_pose_locate(&lock.ctx, &(cn_pose_collection){ &m->photos, &m->scene, dir, &city->config.poses },
                                t->photo, t->work, &index, &query->scene);
        cn_city_lock_drop(&lock);
        if (status == CN_OK) status = open_pixels(ctx, &index, city->config.width_px, t->work, &query->pixels);
        cn_photo_index_deinit(&index);
    }
    free(dir);
    return status;
}

cn_status cn_query_image_localise(const cn_context *ctx, const cn_dataset *dataset, const char *path, const char *dir,
                                  cn_query_image *query)
{
    const char *temporary = getenv("TMPDIR");
    char *work = cn_format("%s/conurb-query-XXXXXX", temporary && *temporary ? temporary : "/tmp");
    *query = (cn_query_image){ 0 };
    if (!work) return cn_fail(CN_ERR_NOMEM, "out of memory");
    if (!mkdtemp(work)) {
        const cn_status status =
            cn_fail(CN_ERR_IO, "cannot make %s: %s; set TMPDIR to a folder that can be written", work, strerror(errno));
        free(work);
        return status;
    }
    cn_status status = find_in(ctx, dataset, &(task){ path, dir, work }, query);
    if (status == CN_OK)
        status = cn_folder_remove(work);
    else
        (void)!cn_folder_remove(work);
    if (status != CN_OK) cn_query_image_deinit(query);
    free(work);
    return status;
}
