/* The part of a static page that shows the city in 3D. */
#ifndef CONURB_VIEW_LIVE_PAGE_H
#define CONURB_VIEW_LIVE_PAGE_H
#include "conurb/view.h"

/* Writes the files of the viewer to page->dir, which is made: chunk-I.js (src/splat/packed.h, in base64), city.js, the
 * scripts, and live.html last. Chunks of an earlier page that had more are removed. Errors as in cn_viewer_export. */
CN_NODISCARD cn_status cn_live_page_write(const cn_context *ctx, cn_city *city, const cn_viewer_page *page);
#endif
