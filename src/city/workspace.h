/* An open city, and the data that its stages read. */
#ifndef CONURB_CITY_WORKSPACE_H
#define CONURB_CITY_WORKSPACE_H
#include "city/config.h"
#include "conurb/photo.h"
#include "conurb/plan.h"
#include "conurb/pose.h"

struct cn_city {
    char *folder;
    cn_config config;
};

/* Joins the city\'s folder with a relative name. Caller frees. NULL when out of memory. */
char *cn_city_path(const cn_city *city, const char *name);

/* The data that most stages need: photos, poses, frame, pixels, plan. Members that were not asked for are zero. */
typedef struct cn_dataset {
    const cn_city *city; /* borrowed */
    cn_photo_index photos;
    cn_scene scene;
    cn_frame frame;
    cn_pixel_store *pixels;
    cn_plan plan;
} cn_dataset;
/* Reads the data. with_plan: also the plan, and the pixels if they exist; rendering works without them. CN_ERR_DATA:
 * the message names the command to run first. */
CN_NODISCARD cn_status cn_dataset_load(const cn_context *ctx, const cn_city *city, bool with_plan, cn_dataset *dataset);
/* CN_ERR_DATA: the pixels do not exist. */
CN_NODISCARD cn_status cn_dataset_need_pixels(const cn_dataset *dataset);
/* Whether the pixels are those of the photos, masks and maps as they are now, at the width of city.yaml. */
CN_NODISCARD cn_status cn_dataset_pixels_current(const cn_dataset *dataset, bool *current);
void cn_dataset_deinit(cn_dataset *dataset);
#endif
