/* city.yaml, parsed and checked. */
#ifndef CONURB_CITY_CONFIG_H
#define CONURB_CITY_CONFIG_H
#include "city/settings.h"

/* The defaults of all keys. Texts are NULL. */
cn_config cn_config_default(void);
/* Reads and checks a city.yaml. CN_ERR_CONFIG: the message begins with FILE:LINE. Relative paths start at the city's
 * folder. */
CN_NODISCARD cn_status cn_config_load(cn_config *config, const char *folder);
void cn_config_deinit(cn_config *config);
/* The training options, with another quality (>= 0) or budget (> 0) than in city.yaml. */
cn_train_options cn_config_train(const cn_config *config, int quality, double time_budget_s);
/* The commented city.yaml that `init` writes; caller frees. NULL when out of memory. */
char *cn_config_template(const char *photos, const char *import, uint32_t width_px);
#endif
