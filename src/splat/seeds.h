/* The first Gaussians: flat ones on the surface that the targets' depths show. */
#ifndef CONURB_SPLAT_SEEDS_H
#define CONURB_SPLAT_SEEDS_H
#include "splat/targets.h"

/* Gaussians as they are fitted, in rows of cn_row_length(degree) floats, with room for `room` of them. */
typedef struct cn_splat_set {
    float *rows;
    size_t n, room;
    uint32_t degree;
    double origin[3];
    double far_m;   /* radius of the sky's sphere about the origin; what lies behind it is put onto it */
    double spacing; /* between seeds, in pixels' footprints */
} cn_splat_set;

/* Fills the set, which has its room and degree: at most one Gaussian in a cube as wide as `spacing` footprints of the
 * pixel that shows the place best, wide enough for all to find room. CN_ERR_DATA: the targets show nothing.
 * CN_ERR_NOMEM, CN_ERR_INTERRUPTED. */
CN_NODISCARD cn_status cn_seeds_make(cn_splat_set *set, const cn_context *ctx, const cn_targets *targets);

/* Where a pixel of a target shows something. */
typedef struct cn_seed {
    uint32_t target, pixel;
    double xyz[3], footprint_m; /* metres from the set's origin; width of a pixel there */
    bool sky;
} cn_seed;
/* False: nothing is there. */
bool cn_seed_at(const cn_splat_set *set, const cn_targets *targets, uint32_t target, uint32_t pixel, cn_seed *seed);
/* Whether a Gaussian there, metres from the set's origin, gets into space that has to stay clear (see clear.h).
 * width_m: its standard deviation. */
bool cn_seed_is_in_clear(const cn_splat_set *set, const cn_targets *targets, const double xyz[3], double width_m);
/* Fills a row with the Gaussian of a pixel: width_m is its standard deviation along the surface. */
void cn_seed_row(const cn_splat_set *set, const cn_targets *targets, const cn_seed *seed, double width_m, float *row);
#endif
