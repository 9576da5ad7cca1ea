/* The signed distance of a city's tiles whose fields have one: from the tile whose centre is nearest. */
#ifndef CONURB_STAGE_SIGNED_DISTANCE_H
#define CONURB_STAGE_SIGNED_DISTANCE_H
#include "conurb/export.h"
#include "render/density.h"

typedef struct cn_city_distance {
    const cn_survey *survey;
    cn_tile **tiles;          /* [survey->n_tiles]; NULL: its field has no distance */
    cn_density_probe *probes; /* [survey->n_tiles][threads] */
    unsigned threads;
    bool any;
} cn_city_distance;

/* Opens the tiles. None is kept open when together they take more than 2 GB. Errors as in cn_tile_open. The survey is
 * borrowed. */
CN_NODISCARD cn_status cn_city_distance_init(cn_city_distance *distance, const cn_context *ctx,
                                             const cn_survey *survey);
void cn_city_distance_deinit(cn_city_distance *distance);
/* In metres, positive in free space; NaN where the nearest tile has none. Threads differ in `worker`. */
void cn_city_distance_at(const cn_city_distance *distance, unsigned worker, size_t n, const double (*xyz)[3],
                         float *distance_m);
#endif
