/* Models as scenes of the collection. */
#ifndef CONURB_POSE_RESULT_H
#define CONURB_POSE_RESULT_H
#include "conurb/pose.h"

/* Finds the photo of each view. Drops views, with a warning that names `where`, whose photo is missing or that no
 * camera fits. raw_pixels: the poses are for the stored pixels, without the EXIF orientation. CN_ERR_DATA: no view is
 * left. */
CN_NODISCARD cn_status cn_pose_tie(const cn_context *ctx, cn_scene *scene, const cn_photo_index *index, bool raw_pixels,
                                   const char *where);
/* Reads a model that COLMAP made from the photos, without those whose pose is wrong (outlier.h). The caller frees the
 * scene, also on failure. */
CN_NODISCARD cn_status cn_pose_read_result(const cn_context *ctx, const cn_photo_index *index, const char *model,
                                           cn_scene *scene);
#endif
