/* One scene from the models of overlapping groups of photos. */
#ifndef CONURB_POSE_MERGE_H
#define CONURB_POSE_MERGE_H
#include "conurb/pose.h"
#include "pose/groups.h"

/* What became of a group. */
typedef enum cn_group_fate {
    CN_GROUP_MISSING, /* it has no model */
    CN_GROUP_JOINED,
    CN_GROUP_APART /* neither shared photos nor GPS tie its model to the others; its photos get no pose from it */
} cn_group_fate;
typedef struct cn_group_report {
    cn_group_fate fate;
    uint32_t n_posed, n_links; /* photos of its model; neighbours that its model was tied to */
    double tie_rms_m;          /* distance between the places that it and its neighbours give to shared points */
} cn_group_report;

typedef enum cn_merge_way { CN_MERGE_WHOLE, CN_MERGE_BY_GROUP } cn_merge_way;
typedef struct cn_merge_report {
    cn_group_report *groups; /* one a group; the caller frees the report */
    uint32_t n_groups, n_joined;
    cn_merge_way way; /* all photos were adjusted at once, or group by group */
    double join_s, adjust_s;
    uint64_t n_dropped; /* observations that did not fit after the adjustment */
} cn_merge_report;

typedef struct cn_merge_task {
    const cn_photo_index *index;
    const cn_photo_groups *groups;
    const cn_scene *models; /* one a group, tied to the index; without views: none. Each has a frame of its own */
    const cn_pose_options *options;
    size_t most_bytes; /* for adjusting all photos at once; else it is done group by group */
} cn_merge_task;

/* Memory for adjusting all at once: half of what the machine has free, at most 4 GiB (some four million
 * observations). */
size_t cn_merge_memory(void);
/* Merges the models.
 *
 * 1. Two models with shared photos are tied by a similarity: RANSAC over centres and axes of shared cameras and over
 *    points that both models see at the same place of a shared photo.
 * 2. The similarities along a spanning tree of the strongest ties place all models in one frame, GPS places that frame
 *    on Earth, and then all similarities are adjusted together, to ties and GPS.
 * 3. Photos take their pose from the group whose core they are in; points that models share become one.
 * 4. Bundle adjustment with GPS as a prior (its stated accuracy, else what the alignment left over), of everything
 *    where that takes no more than task->most_bytes; else of all photos first by their longest tracks, as many as fit,
 *    which settles the lenses, and then group by group, with the photos around a group held.
 * 5. A photo that keeps fewer than 30 observations, and less than a third of those that it came with, is left out.
 *
 * *scene and *frame as from cn_align; models that only GPS ties take part too. One call per scene; the same input gives
 * the same bytes. The caller frees scene and report; both are empty on failure. CN_ERR_DATA: no group has a model. */
CN_NODISCARD cn_status cn_groups_merge(const cn_context *ctx, const cn_merge_task *task, cn_scene *scene,
                                       cn_frame *frame, cn_merge_report *report);
void cn_merge_report_deinit(cn_merge_report *report);

/* ---- The parts ---- */

/* Points that two models see at the same place of a shared photo, and their shared photos. */
typedef struct cn_group_link {
    uint32_t a, b;
    uint32_t first_point, n_points; /* into cn_group_links.points */
    uint32_t first_photo, n_photos; /* into cn_group_links.photos */
} cn_group_link;
typedef struct cn_shared_point {
    uint32_t a, b; /* points of the two models */
} cn_shared_point;
typedef struct cn_shared_photo {
    uint32_t a, b; /* views of the two models */
} cn_shared_photo;
typedef struct cn_group_links {
    cn_group_link *links; /* sorted by a, then b; a < b */
    uint32_t n;
    cn_shared_point *points;
    cn_shared_photo *photos;
    uint32_t n_points, n_photos;
} cn_group_links;
CN_NODISCARD cn_status cn_group_links_find(const cn_merge_task *task, cn_group_links *out);
void cn_group_links_deinit(cn_group_links *links);

/* Where a model lies: world = similarity(model's frame). */
typedef struct cn_group_place {
    bool placed;
    cn_similarity to_world;
} cn_group_place;
/* The group that each photo of the index has its pose from: the one whose core it is in, where that poses it, else the
 * first that does; UINT32_MAX: none. places NULL: whether a group is placed or not. */
void cn_group_givers(const cn_merge_task *task, const cn_group_place *places, uint32_t *giver);
/* Steps 1 and 2. places: one a group. */
CN_NODISCARD cn_status cn_groups_place(const cn_context *ctx, const cn_merge_task *task, const cn_group_links *links,
                                       cn_group_place *places, cn_frame *frame, cn_merge_report *report);
/* Step 3: the scene, and the group that each of its views has its pose from. The caller frees both. */
CN_NODISCARD cn_status cn_groups_assemble(const cn_merge_task *task, const cn_group_links *links,
                                          const cn_group_place *places, cn_scene *scene, uint32_t **home);
/* Step 4. */
CN_NODISCARD cn_status cn_groups_adjust(const cn_context *ctx, const cn_merge_task *task, const uint32_t *home,
                                        cn_scene *scene, cn_frame *frame, cn_merge_report *report);
#endif
