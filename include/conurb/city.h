/* conurb/city.h: a city's workspace: its folder and its city.yaml. */
#ifndef CONURB_CITY_H
#define CONURB_CITY_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

/* A workspace that is open: its folder, its parsed city.yaml. */
typedef struct cn_city cn_city;

typedef struct cn_init_options {
    const char *photos; /* folder; required */
    const char *import; /* COLMAP model, transforms.json or NULL */
    uint32_t width_px;  /* 0: 800 */
} cn_init_options;
/* Makes CITY with a commented city.yaml. CN_ERR_USAGE when CITY already is a workspace; CN_ERR_DATA when there are no
 * photos. */
CN_API CN_NODISCARD cn_status cn_city_init(const cn_context *ctx, const char *city, const cn_init_options *options);
/* Opens CITY; CN_ERR_CONFIG with file:line for unknown keys and wrong types; CN_ERR_VERSION for a newer workspace. */
CN_API CN_NODISCARD cn_status cn_city_open(cn_city **city, const char *folder);
CN_API void cn_city_close(cn_city **city);
CN_API const char *cn_city_folder(const cn_city *city);

#ifdef __cplusplus
}
#endif
#endif
