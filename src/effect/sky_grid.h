#ifndef CONURB_EFFECT_SKY_GRID_H
#define CONURB_EFFECT_SKY_GRID_H

/* A photo's hints are a grid over it, rows of CN_SKY_HINT_X cells from the top. */
enum { CN_SKY_HINT_X = 256, CN_SKY_HINT_Y = 192, CN_SKY_HINTS = CN_SKY_HINT_X * CN_SKY_HINT_Y };

/* CN_SKY_NONE: the photo shows no sky there. CN_SKY_NONE_LATE: so too, but training has gone on for so long that no
 * more matter is asked for there. Neither tells the sky's colour. CN_SKY_NONE_LAST: so too, but training is about to
 * end, and where matter still lacks, the sky may stand for it. */
typedef enum cn_sky_hint { CN_SKY_UNKNOWN, CN_SKY_NONE, CN_SKY_SHOWN, CN_SKY_NONE_LATE, CN_SKY_NONE_LAST } cn_sky_hint;
#endif
