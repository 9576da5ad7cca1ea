/* How the cameras were held when the photos were taken. */
#ifndef CONURB_POSE_ALIGN_HELD_H
#define CONURB_POSE_ALIGN_HELD_H
#include "conurb/pose.h"

/* The side that is up, of most photos of a scene without GPS (see align_held.c). Reads up to a dozen of the photos
 * where the cameras do not tell; photos that cannot be read do not count. Photos with GPS have EXIF, which tells how
 * they are held. */
cn_side cn_held_find_side(const cn_scene *scene, const cn_photo_index *index);

/* n rotations (cam_from_scene, rows right, down and ahead), one for each view, as if the photos were turned until that
 * side is at the top. left_out: n marks, all false at first. Both are owned. */
typedef struct cn_held {
    uint32_t n;
    double (*rotation)[9];
    bool *left_out;
} cn_held;

/* False when memory ran out. The caller frees it with cn_held_deinit, in any case. */
bool cn_held_init(const cn_scene *scene, cn_side up, cn_held *held);
void cn_held_deinit(cn_held *held);
/* Adds up row `axis` (0 right, 1 down, 2 ahead) of the photos that are not left out, nor `without`, as a matrix of
 * products. */
void cn_held_gram(const cn_held *held, int axis, uint32_t without, double gram[9]);
#endif
