/* Depths that a field renders, moved to where the photos match. Private to surface/. */
#ifndef CONURB_SURFACE_REFINE_H
#define CONURB_SURFACE_REFINE_H
#include "surface/depth_maps.h"

/* Fills maps->pixels from maps->rendered: a depth that stereo finds in the photos (source->pixels), beginning at the
 * rendered one, takes its place; the others stay. What an earlier run has done is not done again. Memory: 16 bytes for
 * each pixel of 128 maps. Reports the part that is done of 1. CN_ERR_NOMEM, CN_ERR_IO, CN_ERR_INTERRUPTED. */
CN_NODISCARD cn_status cn_depth_maps_refine(cn_depth_maps *maps, const cn_context *ctx,
                                            const cn_surface_source *source);
#endif
