/* Maps all photos at once (Pan et al. 2024, "Global structure-from-motion revisited"). */
#ifndef CONURB_POSE_GLOBAL_H
#define CONURB_POSE_GLOBAL_H
#include "conurb/pose.h"

typedef struct cn_global_task {
    const cn_context *ctx;
    const cn_photo_index *index;
    const char *database; /* path */
    bool linked;          /* photos have numbers for names; see colmap.h */
    bool fix_focal;       /* keeps the focal lengths of the database */
} cn_global_task;
/* Poses from the verified matches of a COLMAP database: rotations of pairs are averaged, then cameras and points are
 * placed together, then adjusted. The scene has the names of COLMAP, its cameras in COLMAP's order, and a part of the
 * points. It is empty, without a failure, where this way does not hold, and the log says why: neither EXIF nor the
 * pairs tell a camera's focal length, or fewer than half of the photos find a place. The caller frees it. */
CN_NODISCARD cn_status cn_global_map(const cn_global_task *task, cn_scene *scene);
#endif
