/* From matches to a model. */
#ifndef CONURB_POSE_MAPPING_H
#define CONURB_POSE_MAPPING_H
#include "pose/colmap_job.h"

typedef enum cn_global_way { CN_GLOBAL_NONE, CN_GLOBAL_OWN, CN_GLOBAL_COLMAP } cn_global_way;
typedef struct cn_mapping {
    const char *suffix;   /* of the stage and of its folder: "" or "-2" */
    bool fix_focal;       /* keeps the focal length of EXIF */
    cn_global_way global; /* all photos at once, by Conurb's mapper or by COLMAP's; NONE: one after the other */
} cn_mapping;
typedef struct cn_mapped {
    char *model;  /* folder of the largest model; NULL: COLMAP finds no poses */
    char *folder; /* of all models that COLMAP made; NULL: none */
    uint32_t n_models, n_photos, n_points;
    uint32_t n_at_once;      /* photos that Conurb's global mapper placed; 0: it did not map */
    uint32_t n_elsewhere;    /* photos of other models that GPS places */
    uint32_t attempt;        /* that found it, from 1 */
    uint32_t n_gps, n_agree; /* photos of the model with GPS, and those of them that agree with it */
    uint32_t n_core;         /* photos of the model that are in the core of the group */
    double error_px;
} cn_mapped;
void cn_mapped_deinit(cn_mapped *mapped);

/* Maps the job's matches in the way of the job, into a folder of its own, unless that is done already. A model whose
 * focal lengths across and down differ more than those of real lenses is adjusted with one focal length. */
CN_NODISCARD cn_status cn_colmap_map(cn_colmap_job *j, const cn_mapping *how, cn_mapped *out);
/* The model in folder `from`, whose cameras j->database has, with the focal lengths of the database and SIMPLE_RADIAL
 * in place of OPENCV: all cameras move to where these lenses would have stood, and COLMAP adjusts the rest. Nothing is
 * mapped again. *model: its folder, which the caller frees; NULL on failure. */
CN_NODISCARD cn_status cn_colmap_settle_focal(cn_colmap_job *j, const char *from, char **model);
/* Whether this COLMAP has the command global_mapper (from COLMAP 4 on). */
bool cn_colmap_has_global_mapper(const char *colmap);
#endif
