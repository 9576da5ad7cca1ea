/* The occupancy grid: which cells of contracted space hold anything, so that a march skips the rest. */
#ifndef CONURB_FIELD_OCCUPANCY_H
#define CONURB_FIELD_OCCUPANCY_H
#include "field/field.h"

typedef struct cn_occupancy {
    float *thickness;   /* CN_OCC_CELLS: decayed maximum of sigma times the cell's side; < 0: never to be used */
    uint32_t *bits;     /* CN_OCC_CELLS / 32 */
    uint32_t *candidates; uint32_t n_candidates; /* cells that may be used, in shuffled order */
    float threshold;    /* thickness from which a cell is full */
    uint64_t cursor;    /* next candidate to refresh */
} cn_occupancy;

void cn_occupancy_take(cn_occupancy *occ, cn_arena *arena);
/* Every cell that `usable` allows starts occupied; usable[CN_OCC_CELLS]. */
void cn_occupancy_reset(cn_occupancy *occ, const uint8_t *usable, uint64_t seed);
/* The candidates follow from the signs of thickness: for a resume. */
void cn_occupancy_restore(cn_occupancy *occ, uint64_t seed);
/* Centre of a cell in box units (uncontracted). */
void cn_occupancy_centre(uint32_t cell, float x[3]);
/* Positions of the next n (a multiple of CN_PANEL) cells to refresh, jittered inside their cells, to pos[panel][3][lane]. */
void cn_occupancy_pick(const cn_occupancy *occ, uint64_t seed, uint32_t n, float *pos, uint32_t *cells);
/* Cell of a contracted position in [0,1]. */
uint32_t cn_occupancy_cell(float x, float y, float z);
/* Takes in density logits seen in cells. */
void cn_occupancy_update(cn_occupancy *occ, uint32_t n, const uint32_t *cells, const float *logit);
/* Ends a step that picked n cells: moves the cursor on, and now and then looks at the mean again. */
void cn_occupancy_advance(cn_occupancy *occ, uint32_t n);
#endif
