/* A multiresolution grid of feature pairs, hashed where a level does not fit the table (Mueller et al. 2022). */
#ifndef CONURB_FIELD_GRID_H
#define CONURB_FIELD_GRID_H
#include "conurb/base.h"
#include "kernel/kernel.h"

typedef struct cn_grid {
    uint32_t n_levels;
    cn_level level[CN_MAX_LEVELS];
    size_t entries; /* of all levels */
} cn_grid;

/* Levels grow from base to finest by a constant factor. most_entries: entries of one level at most, a power of two; a
 * larger level is hashed. 0: no level is hashed. CN_ERR_CONFIG: invalid sizes. */
CN_NODISCARD cn_status cn_grid_layout(cn_grid *grid, uint32_t levels, uint32_t base, uint32_t finest,
                                      uint32_t most_entries);

/* Adds to d_pos[n][3] the gradients of positions in [0,1], from those of their features. pos[panel][3][lane]. */
void cn_grid_position_gradient(const cn_grid *grid, const uint32_t *table, const float *pos, const cn_panel_rows *d_enc,
                               uint32_t n, float (*d_pos)[3]);
#endif
