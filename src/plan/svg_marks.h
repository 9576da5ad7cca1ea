/* plan.svg: what the map and the words around it share. */
#ifndef CONURB_PLAN_SVG_MARKS_H
#define CONURB_PLAN_SVG_MARKS_H
#include "plan/plan.h"
#include <stdio.h>

#define CN_SVG_MAP_LEFT 24.0
#define CN_SVG_MAP_TOP 84.0
#define CN_SVG_PANEL_WIDTH 368.0 /* right of the map, with both margins */
#define CN_SVG_HELD_OUT "#b3001b"

typedef struct cn_svg_map {
    FILE *out;
    const cn_plan *plan;
    const cn_plan_input *input;
    double px_per_m, west_m, north_m; /* local place of the map's top left corner */
    double width, height;             /* of the map, px */
    uint32_t n_held_out;
    const uint32_t *home; /* nearest tile of each view; UINT32_MAX: none */
    const bool *held;     /* of each view */
} cn_svg_map;

const char *cn_svg_colour(uint32_t tile);
void cn_svg_text(FILE *out, double x, double y, const char *attributes, const char *text); /* escaped */
/* Camera sign at (x, y), turned by degrees clockwise from up: a frustum, or a photo seen from above for one that looks
 * down. */
void cn_svg_camera(FILE *out, double x, double y, double turn_deg, bool down, const char *colour, bool held);
#endif
