/* A town whose shape is known: a square block on flat ground, as a tile written by the test, with photos from above. */
#ifndef CONURB_TEST_EXPORT_TOWN_H
#define CONURB_TEST_EXPORT_TOWN_H
#include "conurb/export.h"

#define TOWN_GROUND (-4.0)
#define TOWN_ROOF 0.0  /* where |x| < 2 and |y - 1| < 2 */
#define TOWN_CELL 0.25 /* of the tile's occupancy: what edges are good for */

enum { TOWN_VIEWS = 4, TOWN_POINTS = 50 };
typedef struct town {
    cn_camera camera;
    cn_view views[TOWN_VIEWS];
    cn_point points[TOWN_POINTS];
    cn_observation observations[3]; /* of every point */
    uint32_t all_views[TOWN_VIEWS];
    cn_scene scene;
    cn_frame frame;
    cn_survey_tile tiles[2]; /* the same twice */
    cn_survey survey;        /* of the first; no colour */
    char folder[64], *tile_file;
} town;
bool town_has(double x, double y, double z);
cn_status town_init(town *t);
void town_place(town *t); /* its frame is on Earth, in UTM zone 32N */
/* Easting, northing and ellipsoidal height of a local place, by GDAL. */
void town_utm(const town *t, const double local[3], double place[3]);
void town_deinit(town *t);
#endif
