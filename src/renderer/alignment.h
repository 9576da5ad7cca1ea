/* Rows of a light matched between tiles: made once, kept in CITY/match. */
#ifndef CONURB_RENDERER_ALIGNMENT_H
#define CONURB_RENDERER_ALIGNMENT_H
#include "record/record.h"
#include "renderer/tile_cache.h"

/* The identity of a match of a plain light (mean, a photo's, or fitted to a photo); its file is stage->stamp. */
CN_NODISCARD cn_status cn_stage_alignment(const cn_city *city, const cn_plan *plan, const cn_appearance_spec *spec,
                                          cn_stage *stage);
/* Puts the matched rows of a light, and of those that it is mixed from, into the tiles's rows; from then on
 * cn_appearance_spec_row gives them. What is missing is made when `make` is set, and left out otherwise; when another
 * process is at it, waits. With compose.match off, or a single tile, there is nothing to do. *hash (may be NULL) takes
 * in what was put in. */
CN_NODISCARD cn_status cn_tile_cache_align(cn_tile_cache *tiles, const cn_context *ctx, const cn_appearance_spec *spec,
                                           bool make, uint64_t *hash);
/* The same of what EXIF says of a photo (CN_APPEARANCE_KNOWN), for the tiles that may show in a view: they are matched
 * to the nearest that knows the photo. The photo's pixels are not looked at, and nothing is kept beyond the tiles. */
CN_NODISCARD cn_status cn_tile_cache_align_known(cn_tile_cache *tiles, const cn_context *ctx,
                                                 const cn_appearance_spec *spec, const cn_view *view);
#endif
