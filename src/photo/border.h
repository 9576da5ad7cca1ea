/* Borders of one colour that were put around a photo. Private to photo/. */
#ifndef CONURB_PHOTO_BORDER_H
#define CONURB_PHOTO_BORDER_H
#include <stdint.h>

typedef struct cn_photo_border {
    uint32_t left, right, top, bottom; /* pixels */
} cn_photo_border;

/* Finds white passe-partouts and black bars, as photos from the web have: rows at the top and bottom, or columns at the
 * left and right, of one colour, which end at once. rgba[height][width][4]: display-encoded. All 0: none. */
cn_photo_border cn_photo_find_border(const float *rgba, uint32_t width, uint32_t height);
#endif
