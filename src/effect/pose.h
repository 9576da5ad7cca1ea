/* What pose refinement asks of the photos' rows after a step of training, for whoever does it. */
#ifndef CONURB_EFFECT_POSE_H
#define CONURB_EFFECT_POSE_H
#include <stdint.h>

/* The trends that moves of n cameras must not have, from the cameras' places (any unit): trend[i][k] is camera i's
 * place along axis k, the mean taken away, and scaled so that the squares over all cameras have a sum of 1. 0 along an
 * axis without places, and for few cameras. place and trend may be the same memory. */
void cn_pose_trends(uint32_t n, const float (*place)[3], float (*trend)[3]);
/* What a step leaves of each parameter, at this fraction of the schedule: the given pose pulls. */
float cn_pose_keep(double progress);
#endif
