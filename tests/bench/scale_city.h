/* A synthetic city of any number of photos over 1 km2, the size of Block-NeRF's Alamo Square: a car with 12 cameras
 * drives its streets again and again. */
#ifndef CONURB_BENCH_SCALE_CITY_H
#define CONURB_BENCH_SCALE_CITY_H
#include "conurb/plan.h"

enum { SIGHTS = 40, CAMERAS = 12 }; /* points that a photo sees; photos of one moment */

typedef struct scale_city {
    cn_scene scene;
    cn_photo_index photos;
    cn_frame frame;
} scale_city;

/* Poses, points and tracks of n photos, the same for the same n. Stops the program when memory runs out. */
void scale_city_make(scale_city *city, uint32_t n);
void scale_city_free(scale_city *city);
#endif
