/* A few dense grids of vertices, trilinearly interpolated, and two small networks. Every vertex has features of its
 * own: no two places share an entry, and memory grows with the cube of the finest resolution. */
#include "field/grid_mlp.h"

/* Levels and resolutions were tuned on fox at 270 px, 1500 steps, held-out PSNR: 4 levels up to 128 24.9 dB, 8 up to
 * 128 25.5 dB, 8 up to 256 27.0 dB (722 MB). With softplus instead of exp, 4 levels up to 192 stayed at 22 dB from
 * step 4000 on, and steps were skipped. */
static const cn_field_option options[] = {
    { "levels", "of the dense grid", 1, 8, { 8, 8, 8, 8, 3 }, true },
    { "base_resolution", "cells across the tile at the coarsest level", 2, 256, { 16, 16, 16, 16, 16 }, true },
    { "finest_resolution", "cells across the tile at the finest level", 2, 500, { 192, 256, 256, 320, 48 }, true },
    CN_GRID_MLP_WIDTHS,
};

static cn_status layout(cn_field *field)
{
    return cn_grid_mlp_layout(field, 0, "dense.grid");
}

const cn_field_type cn_field_type_dense = {
    .name = "dense",
    .summary = "dense multiresolution grid and two small networks",
    .options = options,
    .n_options = sizeof options / sizeof *options,
    .density = CN_DENSITY_EXP,
    .layout = layout,
    CN_GRID_MLP_PASSES,
};
