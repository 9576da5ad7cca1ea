#include "field/grid.h"

#include <math.h>
#include <string.h>

static uint32_t pad4(uint32_t n)
{
    return (n + 3u) & ~3u;
}

cn_status cn_grid_layout(cn_grid *grid, uint32_t levels, uint32_t base, uint32_t finest, uint32_t most_entries)
{
    memset(grid, 0, sizeof *grid);
    if (levels < 1 || levels > CN_MAX_LEVELS)
        return cn_fail(CN_ERR_CONFIG, "field.levels is %u; give 1 to %d", levels, CN_MAX_LEVELS);
    if (base < 2 || finest < base || finest > 1u << 20)
        return cn_fail(CN_ERR_CONFIG,
                       "field.base_resolution is %u and field.finest_resolution %u; the finest may not be less", base,
                       finest);
    const double growth = levels > 1 ? pow((double)finest / base, 1.0 / (levels - 1)) : 1;
    grid->n_levels = levels;
    for (uint32_t l = 0; l < levels; l++) {
        cn_level *level = &grid->level[l];
        level->resolution = (uint32_t)floor(base * pow(growth, l) + 1e-6);
        const double side = level->resolution + 2.0, dense = side * side * side;
        level->hashed = most_entries && dense > (double)most_entries;
        if (!level->hashed && dense > 1u << 27)
            return cn_fail(CN_ERR_CONFIG, "a dense grid of %u cells per side needs too much memory; give 500 at most",
                           level->resolution);
        /* Dense levels are padded to a multiple of 4 entries, so that every level starts on 8 floats. */
        level->entries = level->hashed ? most_entries : pad4((uint32_t)dense);
        level->offset = (uint32_t)grid->entries;
        grid->entries += level->entries;
    }
    return CN_OK;
}

/* Adds the position's gradient from one level, given the gradients of its two features. Scalar C: it runs only when an
 * effect moves rays, and only for samples with weight. */
static void add_level(const cn_level *level, const uint32_t *table, const float pos[3], float g0, float g1,
                      float gradient[3])
{
    float f[3];
    uint32_t c[3];
    for (int a = 0; a < 3; a++) {
        const float x = fminf(fmaxf(pos[a], 0), 1) * (float)level->resolution + 0.5f, cell = floorf(x);
        f[a] = x - cell;
        c[a] = (uint32_t)cell;
    }
    for (uint32_t i = 0; i < 8; i++) {
        const uint32_t pair = table[cn_level_entry(level, c[0] + (i & 1), c[1] + ((i >> 1) & 1), c[2] + (i >> 2))];
        const float value = (g0 * cn_bf16_to_float((uint16_t)pair) + g1 * cn_bf16_to_float((uint16_t)(pair >> 16))) *
                            (float)level->resolution;
        const float w[3] = { (i & 1) ? f[0] : 1 - f[0], (i & 2) ? f[1] : 1 - f[1], (i & 4) ? f[2] : 1 - f[2] };
        gradient[0] += ((i & 1) ? value : -value) * w[1] * w[2];
        gradient[1] += ((i & 2) ? value : -value) * w[0] * w[2];
        gradient[2] += ((i & 4) ? value : -value) * w[0] * w[1];
    }
}

void cn_grid_position_gradient(const cn_grid *grid, const uint32_t *table, const float *pos, const cn_panel_rows *d_enc,
                               uint32_t n, float (*d_pos)[3])
{
    for (uint32_t i = 0; i < n; i++) {
        const size_t panel = i / CN_PANEL, lane = i % CN_PANEL;
        const float *p = pos + panel * 3 * CN_PANEL + lane, *d = d_enc->data + panel * d_enc->stride + lane;
        const float x[3] = { p[0], p[CN_PANEL], p[2 * CN_PANEL] };
        d_pos[i][0] = d_pos[i][1] = d_pos[i][2] = 0;
        for (uint32_t l = 0; l < grid->n_levels; l++)
            add_level(&grid->level[l], table + grid->level[l].offset, x, d[(size_t)2 * l * CN_PANEL],
                      d[((size_t)2 * l + 1) * CN_PANEL], d_pos[i]);
    }
}
