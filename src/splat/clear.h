/* The space that photos look through: before a camera, nearer than its rays begin. A field learns nothing there from
 * that photo, and may hold matter that hangs before other photos. As Gaussians it would stand before the camera. */
#ifndef CONURB_SPLAT_CLEAR_H
#define CONURB_SPLAT_CLEAR_H
#include "base/keys.h"
#include "conurb/pose.h"

typedef struct cn_clear_space {
    const cn_scene *scene; /* borrowed */
    double near_m;
    double (*eyes)[3];
    cn_keys cubes;  /* of the side near_m: the first view whose eye lies there */
    uint32_t *next; /* of each view: another one of its cube, or UINT32_MAX */
} cn_clear_space;
/* Of all views of the scene. near_m 0: no space is clear. CN_ERR_NOMEM. */
CN_NODISCARD cn_status cn_clear_space_init(cn_clear_space *space, const cn_scene *scene, double near_m);
void cn_clear_space_deinit(cn_clear_space *space); /* fine when zeroed */
/* Whether what lies at a place, in local metres, and reaches reach_m about it, gets into such a space. Any number of
 * threads. */
bool cn_clear_space_holds(const cn_clear_space *space, const double xyz[3], double reach_m);
#endif
