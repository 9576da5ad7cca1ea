/* Maps a city's groups of photos. */
#ifndef CONURB_STAGE_POSE_GROUPS_H
#define CONURB_STAGE_POSE_GROUPS_H
#include "conurb/stage.h"

/* One group, under its lock; nothing when it is done. CN_ERR_LOCKED: another process maps it. */
CN_NODISCARD cn_status cn_pose_groups_map_one(const cn_context *ctx, const cn_city *city, const cn_pose_work *work,
                                              uint32_t group);
/* All groups that are due, several at a time where there are enough threads: COLMAP's mapper leaves most of many
 * threads idle. A group that fails does not stop the others; the log names it. CN_ERR_LOCKED: other processes still map
 * some. */
CN_NODISCARD cn_status cn_pose_groups_map(const cn_context *ctx, const cn_city *city, const cn_pose_work *work,
                                          uint32_t n_groups);
#endif
