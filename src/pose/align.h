/* From the poses' frame to local east-north-up. */
#ifndef CONURB_POSE_ALIGN_H
#define CONURB_POSE_ALIGN_H
#include "conurb/pose.h"
#include "pose/similarity.h"

/* Whether a scene without GPS is levelled by the cameras' up direction, and centred. TILTED: only where that direction
 * is more than 30 degrees from the z axis. */
typedef enum cn_levelling { CN_LEVEL_NEVER, CN_LEVEL_TILTED, CN_LEVEL_ALWAYS } cn_levelling;

/* Fills `frame` from the GPS of the views' photos, and transforms the scene into it. Without enough GPS the frame
 * stays local, the log says why, and the scene is levelled as `level` says; else its coordinates are kept. Fails only
 * when out of memory. */
CN_NODISCARD cn_status cn_align(const cn_context *ctx, cn_scene *scene, const cn_photo_index *index, double max_error_m,
                                cn_levelling level, cn_frame *frame);
/* The similarity that takes a scene into a georeferenced frame by the GPS of its views alone; the scene stays as it is.
 * CN_ERR_DATA: GPS does not tell it: less than half of the photos agree with it, or they are too near each other. */
CN_NODISCARD cn_status cn_align_into(const cn_scene *scene, const cn_photo_index *index, double max_error_m,
                                     const cn_frame *frame, cn_similarity *s);
#endif
