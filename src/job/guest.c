#include "job/guest.h"

#include "base/file.h"
#include "job/guard.h"
#include "pose/scene.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

void cn_guest_deinit(cn_guest *guest)
{
    cn_pixel_store_close(&guest->pixels);
    cn_scene_deinit(&guest->scene);
}

/* The store stays open after its file is gone. */
static cn_status open_pixels(const cn_context *ctx, const cn_photo_index *index, uint32_t width_px, const char *work,
                             cn_pixel_store **pixels)
{
    char *path = cn_path_join(work, "pixels.bin");
    cn_status status = path ? cn_pixel_store_build(ctx, index, width_px, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_pixel_store_open(pixels, path);
    free(path);
    return status;
}

/* Chunks of a render on many machines want the same photo: one after another. */
static cn_status take_lock(cn_guard *guard, const cn_context *ctx, const cn_city *city)
{
    cn_status status;
    while ((status = cn_guard_take(guard, ctx, city, "poses", "the poses")) == CN_ERR_LOCKED) {
        if (cn_stopping(ctx)) return cn_fail(CN_ERR_INTERRUPTED, "stopped while another process is at the poses");
        nanosleep(&(struct timespec){ .tv_sec = 1 }, NULL);
    }
    return status;
}

static cn_status find_in(const cn_context *ctx, const cn_material *m, const char *path, const char *work,
                         cn_guest *guest)
{
    const cn_city *city = m->city;
    cn_guard guard;
    cn_photo_index index;
    char *dir = cn_city_path(city, "poses");
    cn_status status = dir ? take_lock(&guard, ctx, city) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) {
        status = cn_pose_locate(&guard.ctx, &m->photos, &m->scene, dir, &city->config.poses, path, work, &index,
                                &guest->scene);
        cn_guard_drop(&guard);
        if (status == CN_OK) status = open_pixels(ctx, &index, city->config.width_px, work, &guest->pixels);
        cn_photo_index_deinit(&index);
    }
    free(dir);
    return status;
}

cn_status cn_guest_find(const cn_context *ctx, const cn_material *material, const char *path, cn_guest *guest)
{
    const char *temporary = getenv("TMPDIR");
    char *work = cn_format("%s/conurb-guest-XXXXXX", temporary && *temporary ? temporary : "/tmp");
    *guest = (cn_guest){ 0 };
    if (!work) return cn_fail(CN_ERR_NOMEM, "out of memory");
    if (!mkdtemp(work)) {
        const cn_status status =
            cn_fail(CN_ERR_IO, "cannot make %s: %s; set TMPDIR to a folder that can be written", work, strerror(errno));
        free(work);
        return status;
    }
    cn_status status = find_in(ctx, material, path, work, guest);
    if (status == CN_OK)
        status = cn_model_remove(work);
    else
        (void)!cn_model_remove(work);
    if (status != CN_OK) cn_guest_deinit(guest);
    free(work);
    return status;
}
