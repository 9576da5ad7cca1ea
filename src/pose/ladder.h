/* Runs COLMAP, in more ways than one when the first finds too few poses. */
#ifndef CONURB_POSE_LADDER_H
#define CONURB_POSE_LADDER_H
#include "conurb/pose.h"
#include "pose/pairs.h"

#define CN_MOST_ATTEMPTS 5

/* Which attempt was kept. */
typedef struct cn_colmap_choice {
    uint32_t attempt; /* from 1 */
    const char *way;  /* its name in plain words; a constant */
    char *database;   /* path; the caller frees it */
} cn_colmap_choice;

typedef struct cn_colmap_task {
    const cn_context *ctx;
    const cn_photo_index *index;
    const char *dir; /* an existing folder */
    const cn_pose_options *options;
    bool fix_focal;           /* keeps the focal length of EXIF */
    bool rig_views;           /* photos are views of rigs: a rig has a pose when some of its views have */
    const bool *core;         /* of each photo: it has to have a pose here. The others are in the core of another group,
                               * where their neighbours are, so fewer of them will do. NULL: all are core. Borrowed. */
    bool colmaps_global;      /* maps all photos at once by COLMAP's global mapper, where the program has one */
    cn_colmap_choice *choice; /* NULL, or filled with what was kept */
} cn_colmap_task;
typedef struct cn_colmap_result {
    char *model, *database; /* folder of the largest model, and the database that it was made from */
    uint32_t n_models;
} cn_colmap_result;

/* Poses the photos in task->dir. Attempts go on until enough photos have a pose, at most options->attempts of them;
 * the model with the most photos is kept, of equal ones the one with the smaller reprojection error. Each stage of
 * each attempt is done once; a stopped run resumes. The caller frees the result with cn_colmap_result_deinit; it is
 * empty on failure. CN_ERR_DATA: no attempt finds poses. */
CN_NODISCARD cn_status cn_colmap_poses(const cn_colmap_task *task, cn_colmap_result *result);
/* Replaces result->model, which cn_colmap_poses made for the same task, by the same with the focal lengths of EXIF and
 * simple lenses; see cn_colmap_settle_focal. On failure the result is as it was. */
CN_NODISCARD cn_status cn_colmap_settle(const cn_colmap_task *task, cn_colmap_result *result);
/* Fills empty pairs with the photos that look alike, from the features of all photos, which COLMAP finds in task->dir
 * (see retrieval.h). */
CN_NODISCARD cn_status cn_colmap_alike(const cn_colmap_task *task, cn_photo_pairs *pairs);
void cn_colmap_result_deinit(cn_colmap_result *result);
#endif
