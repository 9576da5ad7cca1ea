/* From the poses' frame to local east-north-up. */
#ifndef CONURB_POSE_ALIGN_H
#define CONURB_POSE_ALIGN_H
#include "conurb/pose.h"

/* Whether a scene without GPS is levelled by the cameras' up direction, and centred. TILTED: only where that direction
 * is more than 30 degrees from the z axis. */
typedef enum cn_levelling { CN_LEVEL_NEVER, CN_LEVEL_TILTED, CN_LEVEL_ALWAYS } cn_levelling;

/* Fills `frame` from the GPS of the views' photos, and transforms the scene into it. Without enough GPS the frame
 * stays local, the log says why, and the scene is levelled as `level` says; else its coordinates are kept. Fails only
 * when out of memory. */
CN_NODISCARD cn_status cn_align(const cn_context *ctx, cn_scene *scene, const cn_photo_index *index, double max_error_m,
                                cn_levelling level, cn_frame *frame);
/* How many of the views with GPS agree with it (within max_error_m, after the best similarity), without a change to
 * the scene. Both are 0 where GPS does not determine a frame. */
CN_NODISCARD cn_status cn_align_count(const cn_scene *scene, const cn_photo_index *index, double max_error_m,
                                      uint32_t *n_gps, uint32_t *n_inliers);
#endif
