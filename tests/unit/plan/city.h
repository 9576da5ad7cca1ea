/* Synthetic cities for the planner: cameras and points where a test puts them. */
#ifndef CONURB_TESTS_CITY_H
#define CONURB_TESTS_CITY_H
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "conurb/plan.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct city {
    cn_scene scene;
    cn_photo_index photos;
    cn_frame frame;
    char folder[64]; /* a temporary one, removed with the city */
} city;

/* A scene without views yet, with room for n. The frame is local. */
void city_init(city *c, uint32_t n_views, uint32_t n_points, uint32_t n_observations);
void city_deinit(city *c);
/* A camera at (x, y, z) that looks straight down (forward = -z). Named by its number, so in the order of adding. */
void city_look_down(city *c, double x, double y, double z);
/* A camera at (x, y, z) that looks along (dx, dy, 0). */
void city_look_along(city *c, double x, double y, double z, double dx, double dy);
/* A point seen by views first to last. */
void city_point(city *c, double x, double y, double z, uint32_t first, uint32_t last);
void city_georeference(city *c, double latitude_deg, double longitude_deg);
/* n x n cameras that look down from height h, step apart from (0, 0) on; a point under each, seen by it and its
 * neighbour by number. */
void city_survey(city *c, uint32_t n, double step, double h);

/* cn_plan_make of the city, which must succeed. */
void city_plan(const city *c, const cn_plan_options *options, cn_plan *plan);
cn_status city_try(const city *c, const cn_plan_options *options, cn_plan *plan);
bool tile_has(const uint32_t *list, uint32_t n, uint32_t view);
/* Whether a warning of the plan holds the words. */
bool warned(const cn_plan *plan, const char *words);
#endif
