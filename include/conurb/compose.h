/* conurb/compose.h: blends the renders of the tiles in reach into one picture, by inverse distance. */
#ifndef CONURB_COMPOSE_H
#define CONURB_COMPOSE_H
#include "conurb/base.h"
#include "conurb/render.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_compose_options {
    double exponent;   /* p of distance^-p; default 4 */
    double reach;      /* a tile is in reach when the camera is within reach * radius of its centre (horizontal); default 2 */
    uint32_t max_tiles; /* at most this many, nearest first; default 3 */
} cn_compose_options;
CN_API cn_compose_options cn_compose_options_default(void);

/* Weights that sum to 1 over n distances (metres, >= 0). Safe at distance 0 and for any finite exponent: distances are divided by the
 * smallest before the power. Non-finite distances weigh 0. */
CN_API void cn_compose_weights(uint32_t n, const double *distance_m, double exponent, double *weight);
/* Chooses tiles for a camera centre: writes indices and weights (room for max_tiles), returns how many. When none is in
 * reach the nearest one alone is chosen. Distances are horizontal (2D). */
CN_API uint32_t cn_compose_choose(uint32_t n_tiles, const double (*centre)[3], const double *radius_m, const double camera[3],
                                  const cn_compose_options *options, uint32_t *chosen, double *weight);
/* out += weight * picture (premultiplied colour, alpha; depth weighted by alpha). Call cn_compose_finish once all are added. */
CN_API void cn_compose_add(cn_picture *out, const cn_picture *picture, double weight);
CN_API void cn_compose_finish(cn_picture *out);

#ifdef __cplusplus
}
#endif
#endif
