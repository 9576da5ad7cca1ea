/* Rows of an appearance, aligned between tiles: made once and kept in CITY/match. */
#ifndef CONURB_RENDERER_ALIGNMENT_H
#define CONURB_RENDERER_ALIGNMENT_H
#include "record/record.h"
#include "renderer/tile_cache.h"

/* The identity of an alignment (of the mean, a photo's row, or a fit to a photo); its file is stage->stamp. */
CN_NODISCARD cn_status cn_stage_alignment(const cn_city *city, const cn_plan *plan, const cn_appearance_spec *spec,
                                          cn_stage *stage);
/* Adds the aligned rows of an appearance, and of those that it is mixed from, to the rows of `tiles`;
 * cn_appearance_spec_row then returns them. With `make`, missing alignments are made, or waited for while another
 * process makes them; otherwise they are left out. Does nothing when compose.match is off, or for a single tile. *hash
 * (may be NULL) is updated with the rows. */
CN_NODISCARD cn_status cn_tile_cache_align(cn_tile_cache *tiles, const cn_context *ctx, const cn_appearance_spec *spec,
                                           bool make, uint64_t *hash);
/* The same for CN_APPEARANCE_KNOWN, for the tiles in reach of a view: they are aligned to the nearest tile that knows
 * the photo. The photo's pixels are not used, and nothing is written to disk. */
CN_NODISCARD cn_status cn_tile_cache_align_known(cn_tile_cache *tiles, const cn_context *ctx,
                                                 const cn_appearance_spec *spec, const cn_view *view);
#endif
