/* A made city for tests of alignment and of up: cameras in a known local frame, seen from another. */
#ifndef CONURB_TEST_ALIGN_CITY_H
#define CONURB_TEST_ALIGN_CITY_H
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "conurb/pose.h"
#include "math/linalg.h"
#include "pose/align.h"

#include <math.h>
#include <string.h>

enum { N = 24 };
/* From the local frame to the scene's: a turn, a scale and a shift. */
extern const double QUATERNION[4], SCALE, SHIFT[3];

/* From -1 to 1, the same for the same counter. */
double uniform(uint64_t counter);

/* Cameras in a known local frame, seen from a source frame that a similarity away; GPS from the truth. */
typedef struct city {
    cn_scene scene;
    cn_photo photos[N];
    cn_photo_index index;
    double truth[N][3];
    double up[3]; /* local z in the source frame */
} city;

typedef enum view_kind { STREET, SIDEWAYS, NADIR } view_kind;

/* How a level camera of this kind looks at this yaw: rows right, down, ahead. */
void aim(view_kind kind, double yaw, double r[9]);
/* Gives photo i the GPS of a place in the local frame. */
void place_photo(city *c, int i, const double local[3]);
/* line: the cameras are on a line; turning: each looks another way. The caller frees the scene. */
void make_city(city *c, view_kind kind, bool line, bool turning);
/* Turns a view about its own centre, in its own axes. */
void turn_view(cn_view *view, const double turn[9]);
#endif
