/* Where charts lie on square pages. */
#ifndef CONURB_SURFACE_ATLAS_H
#define CONURB_SURFACE_ATLAS_H
#include "surface/charts.h"

enum { CN_ATLAS_GUTTER = 4 }; /* texels between charts, and to a page's border; a power of two, for smaller copies */
typedef struct cn_atlas_page {
    uint32_t side_px;  /* a multiple of 64, or the largest side that was asked for */
    uint32_t first, n; /* charts */
} cn_atlas_page;
typedef struct cn_atlas {
    cn_atlas_page *pages;
    uint32_t n, room;
} cn_atlas;
void cn_atlas_deinit(cn_atlas *atlas); /* fine when zeroed */
/* Puts the charts onto pages of at most side_px texels, in their order, page by page, so that a page is one part of the
 * city. On a page the tallest come first, each where the skyline is lowest. The last page is as small as can be.
 * Changes the charts' page, at_px, and their order. CN_ERR_USAGE: a chart is larger than a page. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_atlas_pack(cn_charts *charts, uint32_t side_px, cn_atlas *atlas);
#endif
