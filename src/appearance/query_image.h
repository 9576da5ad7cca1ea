/* A query photo: a photo that is not in the collection, whose appearance is wanted. */
#ifndef CONURB_APPEARANCE_QUERY_IMAGE_H
#define CONURB_APPEARANCE_QUERY_IMAGE_H
#include "city/workspace.h"

/* Its one view in the city's frame, and its pixels at the city's working width. */
typedef struct cn_query_image {
    cn_scene scene;
    cn_pixel_store *pixels;
} cn_query_image;
/* Finds its pose with cn_pose_locate, in a temporary folder that is removed afterwards. dir: the folder of the city,
 * usually "poses", that gets COLMAP's results of the collection where the poses were imported (see cn_pose_locate). Its
 * lock is waited for and held. The caller deinits the result; it is empty on failure. */
CN_NODISCARD cn_status cn_query_image_localise(const cn_context *ctx, const cn_dataset *dataset, const char *path,
                                               const char *dir, cn_query_image *query);
void cn_query_image_deinit(cn_query_image *query);
#endif
