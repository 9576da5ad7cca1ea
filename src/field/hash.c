/* The hash grid of Mueller et al. 2022 ("Instant Neural Graphics Primitives"): levels from coarse to fine, the fine
 * ones hashed into a table of fixed size, and two small networks. */
#include "field/grid_mlp.h"

static const cn_field_option options[] = {
    { "levels", "of the hash grid", 1, CN_MAX_LEVELS, { 16, 16, 16, 16, 10 }, true },
    { "log2_table", "entries of a level, as a power of two", 8, 24, { 17, 19, 19, 21, 14 }, true },
    { "base_resolution", "cells across the tile at the coarsest level", 2, 65536, { 16, 16, 16, 16, 16 }, true },
    { "finest_resolution",
      "cells across the tile at the finest level",
      2,
      1048576,
      { 2048, 2048, 2048, 4096, 1024 },
      true },
    CN_GRID_MLP_WIDTHS,
};

static cn_status layout(cn_field *field)
{
    const double log2_table = cn_field_option_of(field, "log2_table");
    if (!(log2_table >= 8 && log2_table <= 24))
        return cn_fail(CN_ERR_CONFIG, "field.log2_table is %g; give 8 to 24", log2_table);
    return cn_grid_mlp_layout(field, 1u << (uint32_t)log2_table, "hash.table");
}

const cn_field_type cn_field_type_hash = {
    .name = "hash",
    .summary = "multiresolution hash grid and two small networks (Mueller et al. 2022)",
    .options = options,
    .n_options = sizeof options / sizeof *options,
    .density = CN_DENSITY_EXP,
    .layout = layout,
    CN_GRID_MLP_PASSES,
};
