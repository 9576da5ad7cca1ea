/* Photos of a wall that the test draws: cameras on a line look at it. With its sparse points, for tests of evidence. */
#ifndef CONURB_TEST_WALL_H
#define CONURB_TEST_WALL_H
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "conurb/plan.h"
#include "effect/sky_turn.h"

enum { WIDTH = 96, HEIGHT = 72, VIEWS = 24, ACROSS = 24, UP = 13, BOX = 50, POINTS = ACROSS * UP + BOX + 64 };
#define WALL_M 20.0
#define ROOF_M 8.0
#define BOX_M 10.0

/* What stands before the wall. STATUE: parked, too smooth for points of its own. TOWER: higher than the photos. CLOUD:
 * above the roof, with sky below. LEAVES: before view LEAVES_VIEW alone. */
typedef enum before { NOTHING, PARKED, STATUE, PASSING, TOWER, CLOUD, LEAVES } before;
enum { LEAVES_VIEW = 9 };

typedef enum sky_kind { NO_SKY, GREY_SKY, BLUE_SKY } sky_kind; /* a blue sky is darker than the wall */

typedef struct wall {
    cn_photo_index index;
    cn_scene scene;
    cn_camera camera;
    cn_view views[VIEWS];
    cn_point points[POINTS];
    cn_observation observations[POINTS * VIEWS];
    cn_pixel_store *pixels;
    cn_plan_tile tile;
    uint32_t photos[VIEWS];
    char folder[64];
    sky_kind sky;
    double falloff;    /* how much darker the corners are, stops */
    bool every_second; /* only in every second photo */
} wall;

/* What the next wall_init draws. */
extern double step_m;      /* between cameras */
extern double thing_grey;  /* of what stands before the wall */
extern cn_side first_turn; /* of view 0 */
extern double gain_stops;  /* of every second photo */
extern unsigned border_px; /* black, at the top and the bottom of photos */
/* West of WHITE_TO_M the wall is as bright as the sky below a dark edge of its roof; east of it is sky. */
extern bool white_wall;
#define WHITE_TO_M 4.0

/* Every second square is a lit window: warmer than what is above the roof, and brighter. */
extern bool windows;

double camera_x(unsigned view);
/* Whether a ray hits what stands before the wall. */
bool in_thing(before what, unsigned view, const double origin[3], const double dir[3]);
/* Adds a point, with an observation in each view that shows it. */
void add_point(wall *w, before what, const double xyz[3], bool of_thing);
/* The photos are in a folder of their own, which wall_deinit removes. falloff, every_second: see wall. */
void wall_init_through(wall *w, before what, sky_kind sky, double falloff, bool every_second);
void wall_init(wall *w, before what, sky_kind sky);
void wall_deinit(wall *w);

typedef double (*measure)(const cn_plan_input *input, const cn_plan_tile *tile);
/* Of a wall that is made for it. */
double evidence(measure of, before what, sky_kind sky);
#endif
