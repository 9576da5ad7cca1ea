/* Photos with a wrong pose, which see a surface from behind. */
#ifndef CONURB_POSE_OPPOSITE_H
#define CONURB_POSE_OPPOSITE_H
#include "conurb/pose.h"

/* Leaves out views that see most of their sparse points from another side than all other views do, and the points that
 * then have fewer than two observations; says which. More than one view in ten are left alone: then it is not known
 * which are wrong. CN_ERR_NOMEM: the scene is as it was. */
CN_NODISCARD cn_status cn_pose_drop_opposite(const cn_context *ctx, cn_scene *scene);
#endif
