#include "pose/parts.h"

#include "base/file.h"
#include "math/linalg.h"
#include "pose/align.h"
#include "pose/colmap.h"
#include "pose/outlier.h"
#include "pose/result.h"
#include "pose/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { FEWEST_PHOTOS = 4 }; /* of a part; not measured apart */

typedef struct search {
    const cn_colmap_task *task;
    const cn_scene *main;
    const cn_frame *frame;
    bool *taken; /* of each photo: it has a pose */
    cn_parts *out;
} search;

void cn_parts_deinit(cn_parts *parts)
{
    for (uint32_t i = 0; i < parts->n; i++)
        cn_scene_deinit(&parts->scenes[i]);
    free(parts->scenes);
    *parts = (cn_parts){ 0 };
}

/* Whether no camera of one scene is nearer to one of the other than both see. */
static bool are_apart(const cn_scene *a, const cn_scene *b)
{
    const double least = cn_scene_median_depth(a) + cn_scene_median_depth(b);
    for (uint32_t i = 0; i < a->n_views; i++)
        for (uint32_t k = 0; k < b->n_views; k++) {
            double at[3], other[3];
            cn_view_centre(&a->views[i], at);
            cn_view_centre(&b->views[k], other);
            if (cn_distance3(at, other) < least) return false;
        }
    return true;
}

static cn_status keep_new(search *s, cn_scene *scene)
{
    bool *keep = malloc(scene->n_views + (size_t)1);
    if (!keep) return cn_fail(CN_ERR_NOMEM, "out of memory looking for separate parts");
    for (uint32_t i = 0; i < scene->n_views; i++)
        keep[i] = !s->taken[scene->views[i].photo];
    const cn_status status = cn_scene_keep_views(scene, keep);
    free(keep);
    CN_TRY(status);
    return cn_pose_drop_unsupported(NULL, scene);
}

/* Takes the scene, or leaves it to the caller. */
static cn_status consider(search *s, cn_scene *scene, bool *fits)
{
    const cn_colmap_task *task = s->task;
    cn_similarity place;
    *fits = false;
    CN_TRY(keep_new(s, scene));
    if (scene->n_views < FEWEST_PHOTOS) return CN_OK;
    const cn_status status = cn_align_into(scene, task->index, task->options->max_error_m, s->frame, &place);
    if (status == CN_ERR_DATA) return CN_OK;
    CN_TRY(status);
    cn_scene_transform(scene, place.scale, place.rotation, place.translation);
    *fits = are_apart(scene, s->main);
    for (uint32_t i = 0; i < s->out->n && *fits; i++)
        *fits = are_apart(scene, &s->out->scenes[i]);
    if (!*fits) return CN_OK;
    cn_scene *more = realloc(s->out->scenes, (s->out->n + (size_t)1) * sizeof *more);
    if (!more) return cn_fail(CN_ERR_NOMEM, "out of memory looking for separate parts");
    s->out->scenes = more;
    more[s->out->n++] = *scene;
    s->out->n_views += scene->n_views;
    for (uint32_t i = 0; i < scene->n_views; i++)
        s->taken[scene->views[i].photo] = true;
    return CN_OK;
}

static cn_status read_parts(search *s, const char *folder, const char *largest)
{
    cn_status status = CN_OK;
    for (unsigned k = 0; status == CN_OK; k++) {
        cn_scene scene = { 0 };
        bool fits = false;
        char *path = cn_format("%s/%u", folder, k);
        const bool there = path && cn_model_photos(path) > 0;
        if (!path) status = cn_fail(CN_ERR_NOMEM, "out of memory looking for separate parts");
        if (there && strcmp(path, largest) != 0) {
            status = cn_pose_read_result(NULL, s->task->index, path, &scene);
            if (status == CN_OK) status = consider(s, &scene, &fits);
            if (!fits || status != CN_OK) cn_scene_deinit(&scene);
            /* A model that cannot be used is no part. */
            if (status == CN_ERR_DATA || status == CN_ERR_FORMAT) status = CN_OK;
        }
        free(path);
        if (!there) break;
    }
    return status;
}

cn_status cn_parts_find(const cn_colmap_task *task, const char *folder, const cn_scene *main, const cn_frame *frame,
                        cn_parts *out)
{
    char *largest = NULL;
    uint32_t n_models = 0;
    *out = (cn_parts){ 0 };
    if (task->core || task->rig_views || !folder || !frame->georeferenced) return CN_OK;
    CN_TRY(cn_colmap_find_model(folder, &largest, &n_models));
    search s = { task, main, frame, calloc(task->index->n_photos + (size_t)1, sizeof *s.taken), out };
    cn_status status = s.taken ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory looking for separate parts");
    for (uint32_t i = 0; i < main->n_views && s.taken; i++)
        if (main->views[i].photo != UINT32_MAX) s.taken[main->views[i].photo] = true;
    if (status == CN_OK && n_models > 1) status = read_parts(&s, folder, largest);
    free(largest);
    free(s.taken);
    if (status != CN_OK) cn_parts_deinit(out);
    return status;
}
