#include "pose/result.h"

#include "pose/colmap.h"
#include "pose/outlier.h"
#include "pose/scene.h"

#include <stdlib.h>

enum { NAMED_AT_MOST = 10 };

cn_status cn_pose_tie(const cn_context *ctx, cn_scene *scene, const cn_photo_index *index, bool raw_pixels,
                      const char *where)
{
    uint32_t n_lost;
    CN_TRY(cn_scene_tie(scene, index, &n_lost));
    bool *keep = malloc(scene->n_views + (size_t)1);
    if (!keep) return cn_fail(CN_ERR_NOMEM, "%s: out of memory", where);
    for (uint32_t i = 0, named = 0; i < scene->n_views; i++) {
        keep[i] = scene->views[i].photo != UINT32_MAX;
        if (!keep[i] && named++ < NAMED_AT_MOST)
            cn_log(ctx, CN_LOG_WARN, "%s: photo %s is not in the collection", where, scene->views[i].name);
    }
    if (n_lost)
        cn_log(ctx, CN_LOG_WARN, "%s: %u of %u photos are not in the collection; they are left out", where, n_lost,
               scene->n_views);
    cn_status status = cn_scene_fit_photos(ctx, scene, index, raw_pixels, keep);
    if (status == CN_OK) status = cn_scene_keep_views(scene, keep);
    free(keep);
    CN_TRY(status);
    if (scene->n_views == 0)
        return cn_fail(CN_ERR_DATA, "%s: none of its photos is in %s; give the folder that it was made for", where,
                       index->folder);
    return CN_OK;
}

cn_status cn_pose_read_result(const cn_context *ctx, const cn_photo_index *index, const char *model, cn_scene *scene)
{
    CN_TRY(cn_scene_read_colmap(scene, model));
    if (cn_colmap_needs_links(index)) CN_TRY(cn_colmap_restore_names(scene, index));
    CN_TRY(cn_pose_tie(ctx, scene, index, true, model));
    CN_TRY(cn_pose_drop_unsupported(ctx, scene));
    return cn_pose_drop_outliers(ctx, scene);
}
