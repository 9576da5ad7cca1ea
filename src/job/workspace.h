/* An open city, and what its stages read. */
#ifndef CONURB_JOB_WORKSPACE_H
#define CONURB_JOB_WORKSPACE_H
#include "job/config.h"
#include "job/stage.h"

struct cn_city {
    char *folder;
    cn_config config;
};

/* What most stages need: photos, poses, frame, pixels, plan. Zeroed where it was not asked for. */
typedef struct cn_material {
    const cn_city *city; /* borrowed */
    cn_photo_index photos;
    cn_scene scene;
    cn_frame frame;
    cn_pixel_store *pixels;
    cn_plan plan;
} cn_material;
/* CN_ERR_DATA names the command to run first. with_plan: the plan too, and pixels where they are: a city of which only
 * the tiles were kept renders without. */
CN_NODISCARD cn_status cn_material_load(const cn_context *ctx, const cn_city *city, bool with_plan,
                                        cn_material *material);
/* CN_ERR_DATA where the pixels are not there. */
CN_NODISCARD cn_status cn_material_need_pixels(const cn_material *material);
void cn_material_deinit(cn_material *material);
#endif
