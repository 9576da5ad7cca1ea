#ifndef CONURB_EFFECT_SKY_GRID_H
#define CONURB_EFFECT_SKY_GRID_H

/* A photo's hints are a grid over it, rows of CN_SKY_HINT_X cells from the top. */
enum { CN_SKY_HINT_X = 256, CN_SKY_HINT_Y = 192, CN_SKY_HINTS = CN_SKY_HINT_X * CN_SKY_HINT_Y };
#endif
