/* The contents of city.yaml. */
#ifndef CONURB_CITY_SETTINGS_H
#define CONURB_CITY_SETTINGS_H
#include "conurb/city.h"
#include "conurb/compose.h"
#include "conurb/plan.h"
#include "conurb/pose.h"
#include "conurb/train.h"

typedef struct cn_config {
    char *photos, *import; /* absolute; import may be NULL */
    uint32_t width_px;
    cn_photo_maps maps;
    cn_pose_options poses; /* strings owned by the config */
    cn_plan_options plan;  /* rules are filled in by the stage */
    double
        probe_share; /* fraction of the predicted training time that the plan may use for probes of effects; 0: none */
    cn_tristate effects[CN_MAX_EFFECTS]; /* in the order of cn_effect_list */
    cn_quality quality;
    cn_train_options train; /* of the quality, with city.yaml's own values */
    cn_train_options by_quality[CN_QUALITIES];
    cn_compose_options compose;
    bool match; /* the appearance of tiles is aligned to a root tile's */
    uint32_t render_width_px, render_frames;
    double render_fps, exposure_ev;
    cn_unseen unseen;
    char *view, *look, *colmap, *centres, *control, *check, *teacher;
    char *device; /* train.device; NULL: the caller's */
} cn_config;
#endif
