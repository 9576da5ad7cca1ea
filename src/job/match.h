/* Rows of a light matched between tiles: made once, kept in CITY/match. */
#ifndef CONURB_JOB_MATCH_H
#define CONURB_JOB_MATCH_H
#include "job/gallery.h"

/* The identity of a match of a plain light (mean, a photo's, or fitted to a photo); its file is stage->seal. */
CN_NODISCARD cn_status cn_stage_match(const cn_city *city, const cn_plan *plan, const cn_light *light, cn_stage *stage);
/* Puts the matched rows of a light, and of those that it is mixed from, into the gallery's rows; from then on
 * cn_light_row gives them. What is missing is made when `make` is set, and left out otherwise; when another process is
 * at it, waits. With compose.match off, or a single tile, there is nothing to do. *hash (may be NULL) takes in what was
 * put in. */
CN_NODISCARD cn_status cn_gallery_match(cn_gallery *gallery, const cn_context *ctx, const cn_light *light, bool make,
                                        uint64_t *hash);
/* The same of what EXIF says of a photo (CN_LIGHT_KNOWN), for the tiles that may show in a view: they are matched to
 * the nearest that knows the photo. The photo's pixels are not looked at, and nothing is kept beyond the gallery. */
CN_NODISCARD cn_status cn_gallery_match_known(cn_gallery *gallery, const cn_context *ctx, const cn_light *light,
                                              const cn_view *view);
#endif
