/* Keeps the depths on which views agree. Private to stereo/. */
#ifndef CONURB_STEREO_CONSISTENCY_H
#define CONURB_STEREO_CONSISTENCY_H
#include "stereo/views.h"

/* The view's depths at the pixels of its own lens: where sources agree with them, or, with `all`, wherever they are
 * known, and interpolated. */
CN_NODISCARD cn_status cn_stereo_keep(const cn_stereo_views *views, uint32_t view, bool all, cn_stereo_map *map);
#endif
