/* Runs COLMAP, in more ways than one when the first finds too few poses. */
#ifndef CONURB_POSE_LADDER_H
#define CONURB_POSE_LADDER_H
#include "pose/colmap_task.h"
#include "pose/pairs.h"

#define CN_MOST_ATTEMPTS 5

typedef struct cn_colmap_result {
    char *model, *database; /* folder of the largest model, and the database that it was made from */
    char *folder;           /* of all models of that attempt, in folders with numbers from 0 */
    uint32_t n_models;
} cn_colmap_result;

/* Poses the photos in task->dir. Attempts go on until enough photos have a pose, at most options->attempts of them;
 * the model with the most photos is kept, with those of the parts beside it (parts.h); of equal ones the one with more
 * points for its reprojection error. Each stage of each attempt is done once; a stopped run resumes. The caller frees
 * the result with cn_colmap_result_deinit; it is empty on failure. CN_ERR_DATA: no attempt finds poses. */
CN_NODISCARD cn_status cn_colmap_poses(const cn_colmap_task *task, cn_colmap_result *result);
/* Replaces result->model, which cn_colmap_poses made for the same task, by the same with the focal lengths of EXIF and
 * simple lenses; see cn_colmap_settle_focal. On failure the result is as it was. */
CN_NODISCARD cn_status cn_colmap_settle(const cn_colmap_task *task, cn_colmap_result *result);
/* Fills empty pairs with the photos that look alike, from the features of all photos, which COLMAP finds in task->dir
 * (see retrieval.h). */
CN_NODISCARD cn_status cn_colmap_alike(const cn_colmap_task *task, cn_photo_pairs *pairs);
void cn_colmap_result_deinit(cn_colmap_result *result);
#endif
