/* Views that stand alone, far from all others. */
#ifndef CONURB_PATH_LONE_H
#define CONURB_PATH_LONE_H
#include "conurb/pose.h"

/* lone[view] is set for views that stand many times as far from the middle of their part as most, without company.
 * part: of each view, any labels. lone: zeroed. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_path_find_lone(const cn_scene *scene, const uint32_t *part, bool *lone);
#endif
