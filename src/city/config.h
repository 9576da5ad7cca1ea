/* city.yaml, parsed and checked. */
#ifndef CONURB_CITY_CONFIG_H
#define CONURB_CITY_CONFIG_H
#include "conurb/city.h"
#include "conurb/compose.h"
#include "conurb/plan.h"
#include "conurb/pose.h"
#include "conurb/train.h"

typedef struct cn_config {
    char *photos, *import; /* absolute; import may be NULL */
    uint32_t width_px;
    cn_pose_options poses;               /* strings owned by the config */
    cn_plan_options plan;                /* rules are filled in by the stage */
    cn_tristate effects[CN_MAX_EFFECTS]; /* in the order of cn_effect_list */
    cn_quality quality;
    cn_train_options train; /* of the quality, with city.yaml's own values */
    cn_compose_options compose;
    bool match; /* the appearance of tiles is aligned to a root tile's */
    uint32_t render_width_px, render_frames;
    double render_fps, exposure_ev;
    char *view, *look, *colmap, *centres;
} cn_config;

/* What holds where city.yaml says nothing. No text is set. */
cn_config cn_config_default(void);
/* CN_ERR_CONFIG: "FILE:LINE: what". Relative paths are taken from the city's folder. */
CN_NODISCARD cn_status cn_config_load(cn_config *config, const char *folder);
void cn_config_deinit(cn_config *config);
/* The training options at another quality (>= 0) or budget (> 0) than city.yaml's. */
cn_train_options cn_config_train(const cn_config *config, int quality, double time_budget_s);
/* The commented city.yaml that `init` writes; caller frees. NULL when out of memory. */
char *cn_config_template(const char *photos, const char *import, uint32_t width_px);
#endif
