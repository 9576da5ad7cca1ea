/* Photos that got a wrong pose. */
#ifndef CONURB_POSE_OUTLIER_H
#define CONURB_POSE_OUTLIER_H
#include "conurb/pose.h"

/* Leaves out views whose pose is wrong (see outlier.c), and the points that then have fewer than two observations; says
 * which. More than one view in ten are left alone: then it is not known which are wrong. CN_ERR_NOMEM: the scene is as
 * it was. */
CN_NODISCARD cn_status cn_pose_drop_outliers(const cn_context *ctx, cn_scene *scene);
/* Leaves out views that too few sparse points hold in place or whose focal length no lens has, and the points that then
 * have fewer than two observations. Says which; ctx: NULL to say nothing. Scenes that would keep fewer than two views
 * stay as they are. Not for poses of other sources, which may have no points. CN_ERR_NOMEM: the scene is as it was, or
 * has lost some of these views. */
CN_NODISCARD cn_status cn_pose_drop_unsupported(const cn_context *ctx, cn_scene *scene);
#endif
