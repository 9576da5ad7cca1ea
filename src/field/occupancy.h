/* The occupancy grid: which cells of contracted space hold anything, so that a march skips the rest. */
#ifndef CONURB_FIELD_OCCUPANCY_H
#define CONURB_FIELD_OCCUPANCY_H
#include "field/field.h"

/* A cell's value is the decayed maximum of what training rays saw of it: transmittance in front of it times the cell's
 * own opacity. So cells empty that are thin, and so do cells that no ray can see for what stands before them (the
 * inside of walls). */
typedef struct cn_occupancy {
    float *seen;       /* CN_OCC_CELLS; < 0: never to be used */
    uint32_t *visited; /* step (from 1) of the last visit */
    uint32_t *bits;    /* CN_OCC_CELLS / 32; x fastest */
} cn_occupancy;

void cn_occupancy_take(cn_occupancy *occ, cn_arena *arena);
/* Every cell that `usable` allows starts full; usable[CN_OCC_CELLS]. */
void cn_occupancy_reset(cn_occupancy *occ, const uint8_t *usable);
/* The bits follow from `seen`, and no cell has been visited: for a resume, or a return to an earlier step. */
void cn_occupancy_restore(cn_occupancy *occ);
/* Centre of a cell in box units (uncontracted). */
void cn_occupancy_centre(uint32_t cell, float x[3]);
/* Cell of a contracted position in [0,1]. */
uint32_t cn_occupancy_cell(float x, float y, float z);
/* Takes in what n samples of a step (counted from 1) saw of their cells, in order. A NaN changes nothing. */
void cn_occupancy_update(cn_occupancy *occ, uint32_t step, uint32_t n, const uint32_t *cells, const float *seen);
/* What a sample sees of its cell. */
float cn_occupancy_seen(float transmittance, float sigma);
#endif
