/* A hash set of the cubes that already hold a point. */
#ifndef CONURB_EXPORT_CUBES_H
#define CONURB_EXPORT_CUBES_H
#include "conurb/base.h"

typedef struct cn_cubes {
    uint64_t *keys;
    size_t n, room;
    double side_m;
} cn_cubes;
/* Zeroed but for the side. */
void cn_cubes_init(cn_cubes *cubes, double side_m);
void cn_cubes_deinit(cn_cubes *cubes);
/* Adds the point's cube; *fresh: it was not in the set. 16 bytes per cube. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_cubes_add(cn_cubes *cubes, const double xyz[3], bool *fresh);
#endif
