/* The up direction, from how the cameras were held and from a wall. */
#ifndef CONURB_POSE_ALIGN_UP_H
#define CONURB_POSE_ALIGN_UP_H
#include "pose/align_held.h"

/* The up direction in the scene's frame, from the cameras, and from a wall where they do not tell (see align_up.c).
 * side: of the photos that is up. False when they do not determine it. */
bool cn_align_up(const cn_scene *scene, cn_side side, double up[3]);
/* How far an up direction is off, in radians, by how much the photos differ. error: the standard deviation; surely: a
 * bound that holds as often as three standard deviations do, so it is wider for few photos; infinite for three or
 * fewer. */
typedef struct cn_up_error {
    double error, surely;
} cn_up_error;
/* The same as cn_align_up for upright photos, where the cameras' right axes alone tell it. */
bool cn_align_up_clear(const cn_scene *scene, double up[3], cn_up_error *error);
/* The normal of a wall in the sparse points (see align_wall.c), which is within 40 degrees of level by `up`. False when
 * there is none. */
bool cn_align_wall(const cn_scene *scene, const double up[3], double normal[3]);
/* True when every view looks within 20 degrees of straight down, on flat ground: there a longer focal length and a
 * greater height give the same pictures. The scene must be in a georeferenced local frame. */
bool cn_align_is_nadir(const cn_scene *scene);
#endif
