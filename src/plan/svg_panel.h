/* The words of plan.svg: title above the map, legend and warnings to its right. */
#ifndef CONURB_PLAN_SVG_PANEL_H
#define CONURB_PLAN_SVG_PANEL_H
#include "plan/svg_marks.h"

/* Draws them. Returns the y of the lowest line. */
double cn_svg_panel(const cn_svg_map *map);
#endif
