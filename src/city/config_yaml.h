/* city.yaml as it is written: a value for each key that is there, NULL for each that is not. */
#ifndef CONURB_CITY_CONFIG_YAML_H
#define CONURB_CITY_CONFIG_YAML_H
#include "conurb/base.h"

#define CN_CONFIG_VERSION 1
#define CN_CONFIG_EFFECTS 6

typedef struct cn_yaml_photos {
    char *folder;
    unsigned *width_px;
} cn_yaml_photos;
typedef struct cn_yaml_poses {
    char *import, *colmap;
    unsigned *matcher, *neighbours, *max_image_px, *refine_focal;
    double *max_error_m;
} cn_yaml_poses;
typedef struct cn_yaml_plan {
    unsigned *layout, *min_photos, *max_tile_photos, *hold_out_every;
    char *centres;
    double *spacing_m, *overlap, *max_tile_gb;
} cn_yaml_plan;
typedef struct cn_yaml_effects {
    unsigned *want[CN_CONFIG_EFFECTS];
} cn_yaml_effects;
typedef struct cn_yaml_train {
    unsigned *quality, *steps, *samples_per_step, *levels, *log2_table, *finest_resolution, *precision;
    uint64_t *seed;
    double *time_budget_s, *stop_gain_db, *checkpoint_every_s, *march_step, *learning_rate;
} cn_yaml_train;
typedef struct cn_yaml_compose {
    unsigned *scheme, *max_tiles, *match;
    double *exponent, *reach, *min_visibility;
} cn_yaml_compose;
typedef struct cn_yaml_render {
    unsigned *width_px, *frames;
    double *fps, *exposure_ev;
    char *view, *look;
} cn_yaml_render;
typedef struct cn_yaml_city {
    unsigned version;
    cn_yaml_photos *photos;
    cn_yaml_poses *poses;
    cn_yaml_plan *plan;
    cn_yaml_effects *effects;
    cn_yaml_train *train;
    cn_yaml_compose *compose;
    cn_yaml_render *render;
} cn_yaml_city;

/* Parses by the schema. CN_ERR_CONFIG with "PATH:LINE: ..." for unknown keys and wrong types; CN_ERR_VERSION for a
 * newer version, whatever else is in the file. Free with cn_yaml_free. */
CN_NODISCARD cn_status cn_yaml_parse(const char *path, const char *text, size_t size, cn_yaml_city **city);
void cn_yaml_free(cn_yaml_city *city);
#endif
