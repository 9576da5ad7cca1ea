/* city.yaml, parsed and checked. */
#ifndef CONURB_CITY_CONFIG_H
#define CONURB_CITY_CONFIG_H
#include "city/settings.h"

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
