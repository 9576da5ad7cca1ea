/* The camera path of a render. */
#ifndef CONURB_STAGE_CAMERA_PATH_H
#define CONURB_STAGE_CAMERA_PATH_H
#include "city/workspace.h"
#include "conurb/path.h"
#include "conurb/stage.h"

/* Makes the path of options->path, orbit or photo, or else the default flight. The caller deinits it, also after a
 * failure. CN_ERR_USAGE: more than one of them is given. */
CN_NODISCARD cn_status cn_route_choose(const cn_context *ctx, cn_city *city, const cn_dataset *dataset,
                                       const cn_city_render_options *options, cn_path *path);
#endif
