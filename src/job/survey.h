/* A city's trained tiles as a survey: for soundings and exports. */
#ifndef CONURB_JOB_SURVEY_H
#define CONURB_JOB_SURVEY_H
#include "conurb/export.h"
#include "job/workspace.h"

typedef struct cn_city_survey {
    cn_survey survey;
    cn_survey_tile *tiles;
    char **paths;
    uint32_t n;
} cn_city_survey;

/* Borrows city and material. The light is the mean and the colour NULL: the caller sets what it needs. CN_ERR_DATA when
 * no tile is trained yet. */
CN_NODISCARD cn_status cn_city_survey_init(cn_city_survey *survey, const cn_city *city, const cn_material *material);
void cn_city_survey_deinit(cn_city_survey *survey);
/* A cn_path_sound: user is a cn_city_sounder. */
typedef struct cn_city_sounder {
    const cn_context *ctx;
    const cn_city *city;
    const cn_material *material;
} cn_city_sounder;
CN_NODISCARD cn_status cn_city_sound(void *user, size_t n, const double (*xy_m)[2], double *ground_m);
#endif
