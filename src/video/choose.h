/* Which pictures of a film are worth keeping: sharp ones, evenly along the camera's motion. */
#ifndef CONURB_VIDEO_CHOOSE_H
#define CONURB_VIDEO_CHOOSE_H
#include <stddef.h>
#include <stdint.h>

typedef struct cn_film_picture {
    double time_s;
    double motion;    /* fractions of the picture's width since the last picture with motion; 0: too little to tell */
    double sharpness; /* larger is sharper; compared with pictures nearby only */
} cn_film_picture;

/* Chooses about one picture for every_s seconds in which the camera moves: as many parts of equal motion, and in each
 * part a sharp picture, rather in its middle. A camera that stands still gives one picture. chosen: room for n; rising.
 * Returns how many, at least 1 where n is not 0. */
size_t cn_film_choose(const cn_film_picture *pictures, size_t n, double every_s, size_t *chosen);
/* How far two small grey pictures of w x h are moved against each other, pixels. */
double cn_film_motion(const uint8_t *before, const uint8_t *after, int w, int h);
double cn_film_sharpness(const uint8_t *grey, size_t stride, int w, int h);
#endif
