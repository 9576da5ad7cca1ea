/* Where sparse points lie in the photos of a tile, on the grid of sky hints. */
#ifndef CONURB_EFFECT_SKY_POINTS_H
#define CONURB_EFFECT_SKY_POINTS_H
#include "conurb/plan.h"

typedef struct cn_sky_points {
    uint32_t *first;     /* [scene->n_views + 2]: observations of a view are first[view] to first[view + 1] */
    uint16_t (*seen)[2]; /* an observation's column and row */
    uint32_t *shown;     /* [n_shown]: points that a photo of the tile shows */
    uint32_t n_shown;
} cn_sky_points;

/* False: out of memory. cn_sky_points_deinit in any case. */
bool cn_sky_points_find(const cn_scene *scene, const cn_plan_tile *tile, cn_sky_points *points);
void cn_sky_points_deinit(cn_sky_points *points);
/* Whether the view observes a point. */
bool cn_sky_points_any(const cn_sky_points *points, uint32_t view);
/* on[CN_SKY_HINTS] becomes 1 where the view sees a point, and where several that other photos show lie in its picture,
 * hidden or not: before them or at them there is matter. 0 elsewhere. */
void cn_sky_points_mark(const cn_sky_points *points, const cn_scene *scene, uint32_t view, uint8_t *on);
#endif
