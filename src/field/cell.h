/* The cell of a level at a position: its eight vertices, their trilinear weights, and the derivatives of the weights.
 * Private to field/. */
#ifndef CONURB_FIELD_CELL_H
#define CONURB_FIELD_CELL_H
#include "kernel/kernel.h"

#include <math.h>

typedef struct cn_cell {
    uint32_t entry[8];
    float weight[8];
    float slope[8][3]; /* derivative of the weight by the position in [0,1] */
} cn_cell;

static inline void cn_cell_find(const cn_level *level, const float place[3], cn_cell *cell)
{
    float f[3];
    uint32_t c[3];
    const float resolution = (float)level->resolution;
    for (int a = 0; a < 3; a++) {
        const float x = fminf(fmaxf(place[a], 0), 1) * resolution + 0.5f, first = floorf(x);
        f[a] = x - first;
        c[a] = (uint32_t)first;
    }
    for (uint32_t i = 0; i < 8; i++) {
        const float w[3] = { (i & 1) ? f[0] : 1 - f[0], (i & 2) ? f[1] : 1 - f[1], (i & 4) ? f[2] : 1 - f[2] };
        cell->entry[i] = cn_level_entry(level, c[0] + (i & 1), c[1] + ((i >> 1) & 1), c[2] + (i >> 2));
        cell->weight[i] = w[0] * w[1] * w[2];
        cell->slope[i][0] = ((i & 1) ? resolution : -resolution) * w[1] * w[2];
        cell->slope[i][1] = ((i & 2) ? resolution : -resolution) * w[0] * w[2];
        cell->slope[i][2] = ((i & 4) ? resolution : -resolution) * w[0] * w[1];
    }
}
#endif
