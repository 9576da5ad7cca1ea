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
/* Finds the photo of each view. Drops views, with a warning that names `where`, whose photo is missing or that no
 * camera fits. raw_pixels: the poses are for the stored pixels, without the EXIF orientation. CN_ERR_DATA: no view is
 * left. */
CN_NODISCARD cn_status cn_pose_tie(const cn_context *ctx, cn_scene *scene, const cn_photo_index *index, bool raw_pixels,
                                   const char *where);
#endif
