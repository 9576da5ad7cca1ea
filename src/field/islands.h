/* Islands of the occupancy grid: full cells that touch no others. */
#ifndef CONURB_FIELD_ISLANDS_H
#define CONURB_FIELD_ISLANDS_H
#include "field/field.h"

/* Fewer cells than this make an island small. Found on the city of `scripts/run` and ten sets of photos
 * (tests/bench/experiments.md). Larger ones may be real: with 32, brighton loses the crown of a tree, with 500 castle
 * loses 3.7 dB. */
enum { CN_ISLAND_LEAST = 16 };

/* Empties the small islands, but not those that hold a sparse point or touch a cell that does: a lamp before the sky,
 * say. The others are matter that training has put up anywhere along the photos' rays, in the colour of what lies
 * behind. Cells touch by faces, edges and corners. bits: [CN_OCC_CELLS / 32]; held: [CN_OCC_CELLS] whether a sparse
 * point is in the cell. Fails without memory, and then nothing has changed. */
CN_NODISCARD cn_status cn_islands_drop(uint32_t *bits, const uint8_t *held);
#endif
