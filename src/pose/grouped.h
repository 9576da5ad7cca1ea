/* Poses of a city in groups: the folder DIR/groups with groups.json, photos.json, and for each group a folder with the
 * work of COLMAP, its model, and group.json or error.json. */
#ifndef CONURB_POSE_GROUPED_H
#define CONURB_POSE_GROUPED_H
#include "pose/groups.h"
#include "pose/ladder.h"
#include "pose/merge.h"

/* What the report says of a group. */
typedef struct cn_group_row {
    uint32_t n, n_core, attempt; /* attempt: 0 unknown */
    char way[96], why[300];      /* why: it has no model; "" when it has one */
} cn_group_row;
typedef struct cn_grouped {
    cn_photo_groups groups;
    cn_merge_report report;
    cn_group_row *rows; /* one a group; NULL: the photos were not posed in groups */
} cn_grouped;
void cn_grouped_deinit(cn_grouped *grouped);

/* The scene of all groups that have a model; the others must have failed, for the same key. The caller frees scene and
 * *grouped, also after a failure. CN_ERR_DATA: a group is not mapped yet (the message names it), or none has a model.
 */
CN_NODISCARD cn_status cn_grouped_merge(const cn_context *ctx, const cn_pose_work *work, cn_scene *scene,
                                        cn_frame *frame, cn_grouped *grouped);
/* A group's photos as an index of their own, in the order of the whole. Strings are borrowed from the whole index; free
 * only sub->photos. */
CN_NODISCARD cn_status cn_group_index(const cn_photo_index *index, const cn_photo_group *group, cn_photo_index *sub);
/* core[i]: photo i of the group's index `sub` is in the group's core. The caller frees it; NULL when out of memory. */
bool *cn_group_core(const cn_photo_index *index, const cn_photo_group *group, const cn_photo_index *sub);
/* DIR/groups/groups.json; as the next. */
char *cn_group_list(const char *dir);
/* DIR/groups/003/NAME for group 2; name NULL: the folder. The caller frees it; NULL when out of memory. */
char *cn_group_path(const char *dir, uint32_t group, const char *name);
#endif
