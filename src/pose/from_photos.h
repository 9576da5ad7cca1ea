/* Poses from the photos alone: COLMAP's, aligned to GPS. */
#ifndef CONURB_POSE_FROM_PHOTOS_H
#define CONURB_POSE_FROM_PHOTOS_H
#include "pose/ladder.h"

/* Poses the photos of task->index in task->dir. *scene is in the frame of the photos' GPS, or levelled without it; the
 * caller frees it. *n_models: separate parts that COLMAP found. Errors as cn_colmap_poses. */
CN_NODISCARD cn_status cn_pose_from_photos(const cn_colmap_task *task, cn_scene *scene, cn_frame *frame,
                                           uint32_t *n_models);
/* True where EXIF states the focal length of a photo. */
bool cn_pose_has_focal(const cn_photo_index *index);
/* Whether an adjustment leaves focal lengths as they are: refine_focal is off, or it is auto, EXIF states a focal
 * length, and the photos look straight down on flat ground. */
bool cn_pose_keeps_focal(const cn_photo_index *index, cn_tristate refine_focal, bool nadir);
#endif
