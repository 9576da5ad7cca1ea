/* Separate parts of a collection: photos of two squares share no matches, so COLMAP makes a model of each, of which one
 * is the largest. GPS tells where the others lie. */
#ifndef CONURB_POSE_PARTS_H
#define CONURB_POSE_PARTS_H
#include "pose/colmap_task.h"

typedef struct cn_parts {
    cn_scene *scenes;
    uint32_t n, n_views; /* n_views: of all of them */
} cn_parts;

/* Finds models besides the largest one in a folder of COLMAP's models, in the frame of `main`, which was aligned to GPS
 * and has the largest one's photos; each holds photos that no other has. A part is left out where its GPS does not
 * tell its place (cn_align_into), and where its cameras are so near to those of others that both may see the same
 * walls: GPS is off by metres, and the walls would stand twice. Groups and rigs have no parts. The caller frees them;
 * they are empty on failure. */
CN_NODISCARD cn_status cn_parts_find(const cn_colmap_task *task, const char *folder, const cn_scene *main,
                                     const cn_frame *frame, cn_parts *out);
void cn_parts_deinit(cn_parts *parts);
#endif
