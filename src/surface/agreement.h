/* How far the depth maps of a place are apart. */
#ifndef CONURB_SURFACE_AGREEMENT_H
#define CONURB_SURFACE_AGREEMENT_H
#include "surface/depth_maps.h"

/* Sets the band of every pixel of a map that has one: four times the median of what other maps' depths differ by, in
 * cubes. Where maps are farther apart than a narrow band, each would carve away what the others show: smooth ground,
 * seen at a flat angle, came out as flakes (castle's yard: a tenth of its depths are 0.7 m off the others', a tenth of
 * its facades' 0.08 m). The band is CN_LATTICE_BAND where that is enough, where fewer than six others show the place,
 * and where they are so far apart that they show no one surface: beyond CN_DEPTH_WIDEST; and where there is sky. Found
 * on castle and the made city: with fewer others the made city's mesh gets surfaces that are wrong (F-score within 0.1
 * m 0.52 instead of 0.58). On all threads; the result does not depend on their number. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_depth_maps_agree(cn_depth_maps *maps, cn_pool *pool, uint32_t map, double cube_m);
#endif
