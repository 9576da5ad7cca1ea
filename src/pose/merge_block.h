/* Adjusts a scene group by group, the photos around a group held. */
#ifndef CONURB_POSE_MERGE_BLOCK_H
#define CONURB_POSE_MERGE_BLOCK_H
#include "pose/adjust.h"

typedef struct cn_block_task {
    cn_scene *scene;
    const uint32_t *home; /* the group of each view */
    uint32_t n_groups;
    const cn_place_prior *priors; /* of each view's centre; NULL: none */
    cn_adjust_options options;
} cn_block_task;
/* One sweep over all groups: a group's views and the points that they see move, other views that see these points stay,
 * and so do all lenses. Groups that see no point together are adjusted at the same time, on the context's pool; the
 * result does not depend on the number of threads. Tells progress in groups. A group that Ceres cannot adjust stays as
 * it is, with a warning. Memory: as for the groups that are adjusted at one time. */
CN_NODISCARD cn_status cn_blocks_adjust(const cn_context *ctx, const cn_block_task *task);
#endif
