/* The occupancy grid: which cells of contracted space hold matter. Ray marching skips the others. */
#ifndef CONURB_FIELD_OCCUPANCY_H
#define CONURB_FIELD_OCCUPANCY_H
#include "field/field.h"

/* A cell's value is the decayed maximum, over training rays, of the transmittance in front of the cell times its
 * opacity. So thin cells become empty, and so do cells that are hidden from every ray (the inside of walls). */
typedef struct cn_occupancy {
    float *seen;       /* CN_OCC_CELLS values; < 0: the cell is never used; > 1: no sample found matter yet */
    uint32_t *visited; /* step (from 1) of the last visit */
    uint32_t *bits;    /* CN_OCC_CELLS / 32; x fastest */
    uint32_t *corners; /* CN_OCC_CELLS / 32; for work */
} cn_occupancy;

void cn_occupancy_take(cn_occupancy *occ, cn_arena *arena);
/* Every cell that `usable` allows starts full; usable[CN_OCC_CELLS]. */
void cn_occupancy_reset(cn_occupancy *occ, const uint8_t *usable);
/* Fills the empty cells of one of so many parts again, where `usable` allowed them, for a while: they have to prove
 * once more that they hold something. A part is blocks of cells from all over the grid. */
void cn_occupancy_refill(cn_occupancy *occ, uint32_t part, uint32_t parts);
/* Fills the corners of walls, where `usable` allowed them. Where two full cells touch at an edge only, a wall goes
 * through both, and its corner is in the two empty cells beside that edge: too small for the samples that visit these,
 * and a leak to the rays that go through. */
void cn_occupancy_close(cn_occupancy *occ);
/* Copies the bits to bits[CN_OCC_CELLS / 32], without the full cells in which no sample ever found matter, and with
 * the corners of walls: what a render shows. Cells without matter had few visits, or none. Most lie along the edges of
 * the photos' views. step: steps done; in the first 500 all full cells are shown. */
void cn_occupancy_shown(const cn_occupancy *occ, uint32_t step, uint32_t *bits);
/* Computes the bits from `seen` and clears `visited`: for a resume or a rollback. */
void cn_occupancy_restore(cn_occupancy *occ);
/* Centre of a cell in box units (uncontracted). */
void cn_occupancy_centre(uint32_t cell, float x[3]);
/* A corner of a cell in box units; bits 0 to 2 of `corner` say which. False: it is infinitely far away. */
bool cn_occupancy_corner(uint32_t cell, uint32_t corner, double x[3]);
/* Cell of a contracted position in [0,1]. */
uint32_t cn_occupancy_cell(float x, float y, float z);
/* What a step in which a cell is visited leaves of its value, in a schedule of so many steps. */
float cn_occupancy_decay(uint32_t steps);
/* Updates the cells from n samples of a step (counted from 1), in order. decay: cn_occupancy_decay. A NaN is ignored.
 */
void cn_occupancy_update(cn_occupancy *occ, uint32_t step, float decay, uint32_t n, const uint32_t *cells,
                         const float *seen);
/* A sample's value for its cell. */
float cn_occupancy_seen(float transmittance, float sigma);
#endif
