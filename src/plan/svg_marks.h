/* plan.svg: what the map and the words around it share. */
#ifndef CONURB_PLAN_SVG_MARKS_H
#define CONURB_PLAN_SVG_MARKS_H
#include "chart/chart.h"
#include "plan/plan.h"

#define CN_SVG_MAP_LEFT 24.0
#define CN_SVG_MAP_TOP 84.0
#define CN_SVG_PANEL_WIDTH 368.0 /* right of the map, with both margins */

typedef struct cn_svg_map {
    cn_chart chart;
    const cn_plan *plan;
    const cn_plan_input *input;
    double px_per_m, west_m, north_m; /* local place of the map's top left corner */
    cn_box box;                       /* of the map, px */
    uint32_t n_held_out;
    const uint32_t *home; /* nearest tile of each view; UINT32_MAX: none */
    const bool *held;     /* of each view */
} cn_svg_map;

/* A camera's sign: a frustum, or a photo seen from above for one that looks down. */
typedef struct cn_camera_sign {
    cn_pose2 pose; /* turned clockwise from up */
    bool down, held;
    const char *colour;
} cn_camera_sign;
void cn_svg_camera(const cn_chart *chart, const cn_camera_sign *sign);
/* The colours of a tile's circle. */
cn_paint cn_svg_tile_paint(uint32_t tile, double opacity);
#endif
