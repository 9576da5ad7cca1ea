/* A few dense grids of vertices, trilinearly interpolated, and two small networks. Every vertex has features of its
 * own: no two places share an entry, and memory grows with the cube of the finest resolution. */
#include "field/grid_mlp.h"

static const cn_field_option options[] = {
    { "levels", "of the dense grid", 1, 8, { 4, 4, 4, 4 }, true },
    { "base_resolution", "cells across the tile at the coarsest level", 2, 256, { 16, 16, 16, 16 }, true },
    { "finest_resolution", "cells across the tile at the finest level", 2, 500, { 128, 192, 192, 256 }, true },
    { "density_width", "units of the density network's hidden layer", 4, 256, { 64, 64, 64, 64 }, true },
    { "colour_width", "units of the colour network's two hidden layers", 4, 256, { 64, 64, 64, 64 }, true },
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
    .density = CN_DENSITY_SOFTPLUS,
    .layout = layout,
    CN_GRID_MLP_PASSES,
};
