/* Fewer Gaussians for many: what a level of detail shows. */
#ifndef CONURB_SPLAT_MERGE_H
#define CONURB_SPLAT_MERGE_H
#include "conurb/splat.h"

/* One Gaussian for each cube of a lattice that holds some of the n Gaussians that `which` lists, n from 1. The cubes
 * are as small as `most` Gaussians allow, most from 1. A cube's Gaussian has the mean and the covariance of its
 * Gaussians, with the opacity times the area as their weights (as Kerbl et al. 2024, "A hierarchical 3D Gaussian
 * representation", do), and covers as much as they do together: by its opacity, and beyond 1 by growing, to twice its
 * size at most. Colours are the weighted means. *cell_m: the side of a cube, metres. The caller destroys *out.
 * CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_splats_merge(const cn_splats *splats, const uint32_t *which, size_t n, size_t most,
                                       cn_splats **out, double *cell_m);
#endif
