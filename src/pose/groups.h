/* Photos in overlapping groups of bounded size, so that COLMAP can map each group on its own.
 *
 * Every photo is in the core of one group. A group also holds photos of its neighbours' cores, those that share most
 * pairs with its own core; they tie the groups together when the models are merged. */
#ifndef CONURB_POSE_GROUPS_H
#define CONURB_POSE_GROUPS_H
#include "conurb/photo.h"
#include "pose/pairs.h"

typedef struct cn_photo_group {
    uint32_t *photos; /* indices of photos: the core, then the shared ones; each part ascending */
    uint32_t n, n_core;
} cn_photo_group;
typedef struct cn_photo_groups {
    cn_photo_group *groups;
    uint32_t n;
} cn_photo_groups;

typedef struct cn_group_split {
    uint32_t n_photos;
    const double (*places)[2];   /* metres in a plane; NULL: the pairs alone say what is near */
    const cn_photo_pairs *pairs; /* of photos that may match */
    uint32_t most;               /* photos of a group at most, at least 8 */
} cn_group_split;

/* Cores have about the same size, up to six tenths of `most`. Places are halved across the longer side until the parts
 * are small enough (a k-d tree), each connected part of the pairs on its own; without places the photos are halved in
 * the order of a breadth-first search through the pairs. The same input gives the same groups. The caller frees the
 * groups; on failure they are empty. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_photo_groups_split(const cn_group_split *split, cn_photo_groups *out);
void cn_photo_groups_deinit(cn_photo_groups *groups);

/* The places of the photos in metres about their mean, from GPS; those without have the place of the next one by name
 * that has one. The caller frees *places. *places is NULL when GPS gives no places: fewer than half of the photos have
 * it, or all at one place. */
CN_NODISCARD cn_status cn_photo_places(const cn_photo_index *index, double (**places)[2]);

/* groups.json. key: what the groups were made from; by: how, in words. Load: key NULL is any; CN_ERR_DATA when there is
 * no file, or one of another key; CN_ERR_FORMAT when it is damaged. */
CN_NODISCARD cn_status cn_photo_groups_save(const cn_photo_groups *groups, const char *key, const char *by,
                                            const char *path);
CN_NODISCARD cn_status cn_photo_groups_load(cn_photo_groups *groups, const char *key, uint32_t n_photos,
                                            const char *path);
#endif
