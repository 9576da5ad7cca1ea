/* Do imported poses agree with the GPS of their photos? */
#ifndef CONURB_POSE_IMPORT_CHECK_H
#define CONURB_POSE_IMPORT_CHECK_H
#include "pose/ladder.h"

/* Poses with their frame. */
typedef struct cn_posed {
    cn_scene scene;
    cn_frame frame;
    uint32_t n_models;
} cn_posed;

/* Where imported poses are doubtful: says so, finds the poses of the photos anew in task->dir, and keeps whichever
 * agree with more of the GPS. task->options->check_import: off does nothing; auto says only how to find them anew where
 * there are more than 200 photos or no COLMAP. A search without result leaves the import. CN_ERR_INTERRUPTED: asked to
 * stop.
 */
CN_NODISCARD cn_status cn_import_check(const cn_colmap_task *task, cn_posed *posed);
#endif
