/* The path that a render is asked for. */
#ifndef CONURB_JOB_ROUTE_H
#define CONURB_JOB_ROUTE_H
#include "job/workspace.h"

/* By options->path, orbit or photo, or else the default flight. Caller deinits, also after a failure. CN_ERR_USAGE when
 * they exclude each other. */
CN_NODISCARD cn_status cn_route_choose(const cn_context *ctx, cn_city *city, const cn_material *material,
                                       const cn_city_render_options *options, cn_path *path);
#endif
