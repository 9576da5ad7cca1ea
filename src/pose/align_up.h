/* The up direction, from how the cameras were held and from a wall. */
#ifndef CONURB_POSE_ALIGN_UP_H
#define CONURB_POSE_ALIGN_UP_H
#include "conurb/pose.h"

/* The up direction in the scene's frame, from the cameras, and from a wall where they do not tell (see align_up.c).
 * False when they do not determine it. */
bool cn_align_up(const cn_scene *scene, double up[3]);
/* The same, where the cameras' right axes alone tell it. *error_rad: how far it may be off, by how much the photos
 * differ. */
bool cn_align_up_clear(const cn_scene *scene, double up[3], double *error_rad);
/* The normal of a wall in the sparse points (see align_wall.c), which is within 40 degrees of level by `up`. False when
 * there is none. */
bool cn_align_wall(const cn_scene *scene, const double up[3], double normal[3]);
/* True when every view looks within 20 degrees of straight down, on flat ground: there a longer focal length and a
 * greater height give the same pictures. The scene must be in a georeferenced local frame. */
bool cn_align_is_nadir(const cn_scene *scene);
#endif
