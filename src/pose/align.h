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
/* True when so few of at least 8 photos agree with their GPS that the poses themselves are in doubt. */
bool cn_align_is_doubtful(uint32_t n_gps, uint32_t n_inliers);
/* True when clearly more of n_gps photos agree with their GPS than n_before. */
bool cn_align_is_clearly_better(uint32_t n_gps, uint32_t n_before, uint32_t n_inliers);
/* True when every view looks within 20 degrees of straight down, on flat ground: there a longer focal length and a
 * greater height give the same pictures. The scene must be in a georeferenced local frame. */
bool cn_align_is_nadir(const cn_scene *scene);
/* The up direction in the scene's frame, from the cameras, and from a wall where they do not tell (see align_up.c).
 * False when they do not determine it. */
bool cn_align_up(const cn_scene *scene, double up[3]);
/* The normal of a wall in the sparse points (see align_wall.c), which is within 40 degrees of level by `up`. False when
 * there is none. */
bool cn_align_wall(const cn_scene *scene, const double up[3], double normal[3]);
#endif
