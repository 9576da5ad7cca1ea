#include "field/occupancy.h"

#include "base/rng.h"

#include <math.h>
#include <stdlib.h>

/* A cell counts as full at this optical thickness: alpha is then a tenth over the cell's side. While the field is still fog
 * everywhere, the mean of the cells decides instead (Instant-NGP does the same), so that the thinner half empties first.
 * Decay: a cell that was full must look empty several visits in a row. */
#define FULL 0.1f
#define DECAY 0.7f
#define CELL_SIDE (4.0f / CN_OCC_RES)
/* Cells visited between two looks at the mean. */
#define THRESHOLD_EVERY 131072u

void cn_occupancy_take(cn_occupancy *occ, cn_arena *arena)
{
    occ->thickness = CN_ARENA_NEW(arena, float, CN_OCC_CELLS);
    occ->bits = CN_ARENA_NEW(arena, uint32_t, CN_OCC_CELLS / 32);
    occ->candidates = CN_ARENA_NEW(arena, uint32_t, CN_OCC_CELLS);
}

static void set_bit(cn_occupancy *occ, uint32_t cell)
{
    const uint32_t mask = 1u << (cell & 31);
    if (occ->thickness[cell] >= occ->threshold)
        occ->bits[cell >> 5] |= mask;
    else
        occ->bits[cell >> 5] &= ~mask;
}

static void set_threshold(cn_occupancy *occ)
{
    double sum = 0;
    for (uint32_t i = 0; i < occ->n_candidates; i++) sum += occ->thickness[occ->candidates[i]];
    (void)sum; occ->threshold = getenv("THR") ? (float)atof(getenv("THR")) : FULL;
}

void cn_occupancy_restore(cn_occupancy *occ, uint64_t seed)
{
    occ->n_candidates = 0;
    memset(occ->bits, 0, CN_OCC_CELLS / 8);
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++) {
        if (occ->thickness[c] < 0) continue;
        occ->candidates[occ->n_candidates++] = c;
    }
    set_threshold(occ);
    for (uint32_t i = 0; i < occ->n_candidates; i++) set_bit(occ, occ->candidates[i]);
    for (uint32_t i = occ->n_candidates; i > 1; i--) { /* Fisher and Yates */
        const uint32_t j = cn_rng_below(seed, 3, i, i);
        const uint32_t swap = occ->candidates[i - 1];
        occ->candidates[i - 1] = occ->candidates[j];
        occ->candidates[j] = swap;
    }
}

void cn_occupancy_reset(cn_occupancy *occ, const uint8_t *usable, uint64_t seed)
{
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++) occ->thickness[c] = usable[c] ? 1 : -1;
    occ->cursor = 0;
    cn_occupancy_restore(occ, seed);
}

static void cell_corner(uint32_t cell, uint32_t c[3])
{
    c[0] = cell % CN_OCC_RES;
    c[1] = cell / CN_OCC_RES % CN_OCC_RES;
    c[2] = cell / (CN_OCC_RES * CN_OCC_RES);
}

void cn_occupancy_centre(uint32_t cell, float x[3])
{
    uint32_t c[3];
    cell_corner(cell, c);
    float m = 0;
    for (int a = 0; a < 3; a++) {
        x[a] = ((float)c[a] + 0.5f) * CELL_SIDE - 2;
        m = fmaxf(m, fabsf(x[a]));
    }
    if (m <= 1) return;
    /* |v| = 2 - 1 / |x|, so x = v / (|v| (2 - |v|)). */
    for (int a = 0; a < 3; a++) x[a] /= m * (2 - m);
}

void cn_occupancy_pick(const cn_occupancy *occ, uint64_t seed, uint32_t n, float *pos, uint32_t *cells)
{
    for (uint32_t i = 0; i < n; i++) {
        const uint64_t at = occ->cursor + i;
        const uint32_t cell = occ->n_candidates ? occ->candidates[at % occ->n_candidates] : 0;
        uint32_t c[3];
        cell_corner(cell, c);
        float *lane = pos + (size_t)(i / CN_PANEL) * 3 * CN_PANEL + i % CN_PANEL;
        for (uint32_t a = 0; a < 3; a++)
            lane[(size_t)a * CN_PANEL] = ((float)c[a] + cn_rng_float(seed, 4 + a, at)) * (1.0f / CN_OCC_RES);
        cells[i] = cell;
    }
}

uint32_t cn_occupancy_cell(float x, float y, float z)
{
    const float v[3] = {x, y, z};
    uint32_t c[3];
    for (int a = 0; a < 3; a++) {
        const float scaled = v[a] * CN_OCC_RES;
        c[a] = scaled > 0 ? (scaled < CN_OCC_RES - 1 ? (uint32_t)scaled : CN_OCC_RES - 1) : 0;
    }
    return c[0] + CN_OCC_RES * (c[1] + CN_OCC_RES * c[2]);
}

void cn_occupancy_update(cn_occupancy *occ, uint32_t n, const uint32_t *cells, const float *logit)
{
    for (uint32_t i = 0; i < n; i++) {
        float *held = &occ->thickness[cells[i]];
        if (*held < 0) continue;
        const float now = expf(fminf(logit[i], 15.0f)) * CELL_SIDE;
        /* !(now >= 0) is a NaN: the cell stays as it is. */
        if (now >= 0) *held = fmaxf(*held * DECAY, now);
        set_bit(occ, cells[i]);
    }
}

void cn_occupancy_advance(cn_occupancy *occ, uint32_t n)
{
    const uint64_t round = occ->cursor / THRESHOLD_EVERY;
    occ->cursor += n;
    if (occ->cursor / THRESHOLD_EVERY == round) return;
    set_threshold(occ);
    for (uint32_t i = 0; i < occ->n_candidates; i++) set_bit(occ, occ->candidates[i]);
}
