/* Photos that stand on their side or head: where the grid of their sky, as the photo looks when it is held upright,
 * lies in the stored picture. */
#ifndef CONURB_EFFECT_SKY_TURN_H
#define CONURB_EFFECT_SKY_TURN_H
#include "conurb/pose.h"

/* Cell (x, y) of an upright grid of n_x columns and n_y rows, and where its middle lies in a stored picture of
 * size[0] x size[1] pixels. */
void cn_sky_turn_to_picture(cn_side up, const int cell[2], const int n[2], const double size[2], double px[2]);
/* The cell of the upright grid of hints at which a cell of the stored grid lies. Both are numbered row by row. */
int cn_sky_turn_to_upright(cn_side up, int at);
#endif
