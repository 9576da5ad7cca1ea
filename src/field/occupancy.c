#include "field/occupancy.h"

#include <math.h>
#include <string.h>

/* Threshold of a full cell, tuned: half of it keeps twice the fog, four times it removes surfaces before they have
 * formed. Decay: a full cell is emptied only when it looks empty in many steps. It decays once per step, because
 * samples just behind a surface share its cell and see nothing. Nothing is learned in an empty cell, so a surface that
 * forms late is lost: a long schedule can wait longer for it, and a short one needs the fog gone soon. At 6000 steps
 * the quick decay costs the made city 1.2 dB; at 1500 a slow one, 0.93, costs fox 2.2 dB. tests/bench/experiments.md
 * has more. */
#define FULL 0.015f
#define DECAY 0.85 /* at DECAY_STEPS or fewer; four times the steps: twice the visits until a cell is empty */
#define DECAY_STEPS 1500.0
#define CELL_SIDE (4.0f / CN_OCC_RES)
/* Is added to the value of a cell in which no visit has found matter yet. Such a cell is full at first, and a value
 * alone, at most 1, could not tell whether a sample found that. */
#define UNPROVEN 2.0f
/* Value of a cell that is filled again. At 6000 steps it is empty after 37 visits in which no matter is found. */
#define REFILLED 0.3f
/* Steps; before, fog is everywhere, and few cells have proof. A third of preview. Not measured apart. */
#define SETTLED 500

void cn_occupancy_take(cn_occupancy *occ, cn_arena *arena)
{
    occ->seen = CN_ARENA_NEW(arena, float, CN_OCC_CELLS);
    occ->visited = CN_ARENA_NEW(arena, uint32_t, CN_OCC_CELLS);
    occ->bits = CN_ARENA_NEW(arena, uint32_t, CN_OCC_CELLS / 32);
}

static bool is_unproven(float seen)
{
    return seen > 1;
}

static float value_of(float seen)
{
    return is_unproven(seen) ? seen - UNPROVEN : seen;
}

static void set_bit(cn_occupancy *occ, uint32_t cell)
{
    const uint32_t mask = 1u << (cell & 31);
    if (value_of(occ->seen[cell]) >= FULL)
        occ->bits[cell >> 5] |= mask;
    else
        occ->bits[cell >> 5] &= ~mask;
}

void cn_occupancy_restore(cn_occupancy *occ)
{
    memset(occ->visited, 0, sizeof *occ->visited * CN_OCC_CELLS);
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++)
        set_bit(occ, c);
}

void cn_occupancy_reset(cn_occupancy *occ, const uint8_t *usable)
{
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++)
        occ->seen[c] = usable[c] ? UNPROVEN + 1 : -1;
    cn_occupancy_restore(occ);
}

static void cell_corner(uint32_t cell, uint32_t c[3])
{
    c[0] = cell % CN_OCC_RES;
    c[1] = cell / CN_OCC_RES % CN_OCC_RES;
    c[2] = cell / (CN_OCC_RES * CN_OCC_RES);
}

/* The part of a cell's block: blocks of 8 cells along each axis, scattered by the hash of Teschner et al. 2003. */
static uint32_t part_of(uint32_t cell, uint32_t parts)
{
    uint32_t c[3];
    cell_corner(cell, c);
    const uint32_t hash = (c[0] >> 3) * 73856093u ^ (c[1] >> 3) * 19349663u ^ (c[2] >> 3) * 83492791u;
    return (hash * 2654435761u >> 16) % parts;
}

void cn_occupancy_refill(cn_occupancy *occ, uint32_t part, uint32_t parts)
{
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++) {
        if (part_of(c, parts) != part) continue;
        if (occ->seen[c] < 0 || value_of(occ->seen[c]) >= FULL) continue;
        occ->seen[c] = UNPROVEN + REFILLED;
        set_bit(occ, c);
    }
}

void cn_occupancy_shown(const cn_occupancy *occ, uint32_t step, uint32_t *bits)
{
    memcpy(bits, occ->bits, sizeof *bits * (CN_OCC_CELLS / 32));
    for (uint32_t c = 0; c < CN_OCC_CELLS && step >= SETTLED; c++)
        if (is_unproven(occ->seen[c])) bits[c >> 5] &= ~(1u << (c & 31));
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
    for (int a = 0; a < 3; a++)
        x[a] /= m * (2 - m);
}

bool cn_occupancy_corner(uint32_t cell, uint32_t corner, double x[3])
{
    uint32_t c[3];
    cell_corner(cell, c);
    double m = 0;
    for (int a = 0; a < 3; a++) {
        x[a] = (c[a] + (corner >> a & 1)) * (double)CELL_SIDE - 2;
        m = fmax(m, fabs(x[a]));
    }
    if (m >= 2) return false;
    for (int a = 0; a < 3 && m > 1; a++)
        x[a] /= m * (2 - m);
    return true;
}

uint32_t cn_occupancy_cell(float x, float y, float z)
{
    const float v[3] = { x, y, z };
    uint32_t c[3];
    for (int a = 0; a < 3; a++) {
        const float scaled = v[a] * CN_OCC_RES;
        c[a] = scaled > 0 ? (scaled < CN_OCC_RES - 1 ? (uint32_t)scaled : CN_OCC_RES - 1) : 0;
    }
    return c[0] + CN_OCC_RES * (c[1] + CN_OCC_RES * c[2]);
}

float cn_occupancy_seen(float transmittance, float sigma)
{
    return transmittance * (1 - expf(-sigma * CELL_SIDE));
}

float cn_occupancy_decay(uint32_t steps)
{
    return (float)pow(DECAY, sqrt(DECAY_STEPS / fmax(steps, DECAY_STEPS)));
}

void cn_occupancy_update(cn_occupancy *occ, uint32_t step, float decay, uint32_t n, const uint32_t *cells,
                         const float *seen)
{
    for (uint32_t i = 0; i < n; i++) {
        float *held = &occ->seen[cells[i]];
        if (*held < 0 || !(seen[i] >= 0)) continue;
        const float kept = occ->visited[cells[i]] == step ? 1 : decay;
        occ->visited[cells[i]] = step;
        const float value = fmaxf(value_of(*held) * kept, seen[i]);
        *held = is_unproven(*held) && seen[i] < FULL && value >= FULL ? UNPROVEN + value : value;
        set_bit(occ, cells[i]);
    }
}
