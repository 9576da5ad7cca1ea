/* A city's trained tiles as a cn_survey, for heights and exports. */
#ifndef CONURB_STAGE_SURVEY_H
#define CONURB_STAGE_SURVEY_H
#include "conurb/export.h"
#include "city/workspace.h"

typedef struct cn_city_survey {
    cn_survey survey;
    cn_survey_tile *tiles;
    char **paths;
    uint32_t n;
} cn_city_survey;

/* Borrows city and dataset. Sets the mean appearance and colour NULL; the caller sets others. CN_ERR_DATA: no tile is
 * trained yet. */
CN_NODISCARD cn_status cn_city_survey_init(cn_city_survey *survey, const cn_city *city, const cn_dataset *dataset);
void cn_city_survey_deinit(cn_city_survey *survey);
/* A cn_path_heights: user is a cn_city_height_sampler. */
typedef struct cn_city_height_sampler {
    const cn_context *ctx;
    const cn_city *city;
    const cn_dataset *dataset;
} cn_city_height_sampler;
CN_NODISCARD cn_status cn_city_heights(void *user, size_t n, const double (*xy_m)[2], double *ground_m);
#endif
