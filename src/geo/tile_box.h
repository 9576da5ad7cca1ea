/* Boxes of 3D Tiles, in the JSON of a tileset: along the axes, each the centre and three half axes. */
#ifndef CONURB_GEO_TILE_BOX_H
#define CONURB_GEO_TILE_BOX_H
#include "base/json.h"

/* Widens the boxes of a tile and of all below it, so that each holds those of its children. */
void cn_tile_box_widen(json_t *tile);
/* The length of a tile's diagonal, in metres. */
double cn_tile_box_across(const json_t *tile);
#endif
