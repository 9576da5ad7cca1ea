/* A photo from outside the collection, for its light. */
#ifndef CONURB_APPEARANCE_QUERY_IMAGE_H
#define CONURB_APPEARANCE_QUERY_IMAGE_H
#include "city/workspace.h"

/* Its one view in the city's frame, and its pixels at the city's working width. */
typedef struct cn_query_image {
    cn_scene scene;
    cn_pixel_store *pixels;
} cn_query_image;
/* Finds its pose (cn_pose_locate; waits for the lock of CITY/poses and holds it meanwhile) in a temporary folder, which
 * is gone after. Caller deinits; empty on failure. */
CN_NODISCARD cn_status cn_query_image_localise(const cn_context *ctx, const cn_dataset *dataset, const char *path,
                                               cn_query_image *query);
void cn_query_image_deinit(cn_query_image *query);
#endif
