/* conurb/compose.h: blends the renders of the tiles in reach into one picture, by inverse distance
 * (Tancik et al., "Block-NeRF", CVPR 2022, section 3.3: w_i ~ distance(camera, tile centre)^-p in image space).
 * Nothing here keeps state: every function may be called from several threads at once, on different outputs. */
#ifndef CONURB_COMPOSE_H
#define CONURB_COMPOSE_H
#include "conurb/base.h"
#include "conurb/render.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef struct cn_compose_options {
    double exponent;   /* p of distance^-p, >= 0; default 4 */
    double reach;      /* a tile is in reach when the camera is within reach * radius of its centre (horizontal); default 2 */
    uint32_t max_tiles; /* at most this many, nearest first; default 3 */
} cn_compose_options;
CN_API cn_compose_options cn_compose_options_default(void);

/* Weights that sum to 1 over n distances (metres, >= 0). Safe at distance 0 and for any exponent >= 0: the smallest distance is
 * divided by each before the power, so nothing overflows; tiles at distance 0 share the whole weight (with exponent 0 all
 * share alike). Non-finite distances weigh 0; when there is no finite one all weights are 0.
 * weight may be the array distance_m. */
CN_API void cn_compose_weights(uint32_t n, const double *distance_m, double exponent, double *weight);
/* Chooses tiles for a camera centre: writes indices (nearest first; equal distances by index) and weights (room for max_tiles),
 * returns how many. When none is in reach the nearest one alone is chosen. Distances are horizontal (2D). 0 only when there
 * are no tiles, max_tiles is 0 or the camera is not finite. */
CN_API uint32_t cn_compose_choose(uint32_t n_tiles, const double (*centre)[3], const double *radius_m, const double camera[3],
                                  const cn_compose_options *options, uint32_t *chosen, double *weight);
/* out += weight * picture (premultiplied colour, alpha; depth weighted by alpha). Both of one size, out zeroed before the first.
 * Call cn_compose_finish once all are added: it turns the summed depth back into metres. */
CN_API void cn_compose_add(cn_picture *out, const cn_picture *picture, double weight);
CN_API void cn_compose_finish(cn_picture *out);

#ifdef __cplusplus
}
#endif
#endif
