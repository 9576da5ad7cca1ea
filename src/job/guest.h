/* A photo from outside the collection, for its light. */
#ifndef CONURB_JOB_GUEST_H
#define CONURB_JOB_GUEST_H
#include "job/workspace.h"

/* Its one view in the city's frame, and its pixels at the city's working width. */
typedef struct cn_guest {
    cn_scene scene;
    cn_pixel_store *pixels;
} cn_guest;
/* Finds its pose (cn_pose_locate; waits for the lock of CITY/poses and holds it meanwhile) in a temporary folder, which
 * is gone after. Caller deinits; empty on failure. */
CN_NODISCARD cn_status cn_guest_find(const cn_context *ctx, const cn_material *material, const char *path,
                                     cn_guest *guest);
void cn_guest_deinit(cn_guest *guest);
#endif
