/* A hash set of the cubes that already hold a point. */
#ifndef CONURB_EXPORT_CUBES_H
#define CONURB_EXPORT_CUBES_H
#include "base/keys.h"

typedef struct cn_cubes {
    cn_keys taken;
    double side_m;
} cn_cubes;
/* Zeroed but for the side. */
void cn_cubes_init(cn_cubes *cubes, double side_m);
void cn_cubes_deinit(cn_cubes *cubes);
/* Adds the point's cube; *fresh: it was not in the set. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_cubes_add(cn_cubes *cubes, const double xyz[3], bool *fresh);
#endif
