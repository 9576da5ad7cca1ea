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
enum { WORDS = CN_OCC_RES / 32 }; /* bits of a row of cells along x */
/* Value of a cell that is filled again. At 6000 steps it is empty after 37 visits in which no matter is found. */
#define REFILLED 0.3f
/* Steps; before, fog is everywhere, and few cells have proof. A third of preview. Not measured apart. */
#define SETTLED 500

void cn_occupancy_take(cn_occupancy *occ, cn_arena *arena)
{
    occ->seen = CN_ARENA_NEW(arena, float, CN_OCC_CELLS);
    occ->visited = CN_ARENA_NEW(arena, uint32_t, CN_OCC_CELLS);
    occ->bits = CN_ARENA_NEW(arena, uint32_t, CN_OCC_CELLS / 32);
    occ->corners = CN_ARENA_NEW(arena, uint32_t, CN_OCC_CELLS / 32);
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

/* The bits of a row, moved so that each cell has the bit of its neighbour at dx. Outside the grid all is empty. */
static void row_beside(const uint32_t *bits, const int row[2], const int d[3], uint32_t moved[WORDS])
{
    const int y = row[0] + d[1], z = row[1] + d[2];
    memset(moved, 0, sizeof *moved * WORDS);
    if (y < 0 || z < 0 || y >= CN_OCC_RES || z >= CN_OCC_RES) return;
    const uint32_t *from = bits + WORDS * ((size_t)y + CN_OCC_RES * (size_t)z);
    for (int w = 0; w < WORDS; w++) {
        const uint32_t before = w ? from[w - 1] >> 31 : 0, after = w + 1 < WORDS ? from[w + 1] << 31 : 0;
        moved[w] = d[0] < 0 ? from[w] << 1 | before : d[0] > 0 ? from[w] >> 1 | after : from[w];
    }
}

/* The corners in a row: empty cells with full neighbours along two axes, and an empty cell beyond both. */
static void find_corners(const uint32_t *bits, const int row[2], uint32_t found[WORDS])
{
    uint32_t here[WORDS], one[WORDS], other[WORDS], beyond[WORDS];
    row_beside(bits, row, (const int[3]){ 0 }, here);
    memset(found, 0, sizeof *found * WORDS);
    for (int i = 0; i < 12; i++) {
        int d[2][3] = { 0 }; /* along one axis, and along the next */
        d[0][i / 4] = i & 1 ? 1 : -1;
        d[1][(i / 4 + 1) % 3] = i & 2 ? 1 : -1;
        row_beside(bits, row, d[0], one);
        row_beside(bits, row, d[1], other);
        row_beside(bits, row, (const int[3]){ d[0][0] + d[1][0], d[0][1] + d[1][1], d[0][2] + d[1][2] }, beyond);
        for (int w = 0; w < WORDS; w++)
            found[w] |= one[w] & other[w] & ~here[w] & ~beyond[w];
    }
}

/* To occ->corners, without the cells that are never used. */
static void note_corners(const cn_occupancy *occ, const uint32_t *bits)
{
    for (int z = 0; z < CN_OCC_RES; z++)
        for (int y = 0; y < CN_OCC_RES; y++)
            find_corners(bits, (const int[2]){ y, z }, occ->corners + WORDS * ((size_t)y + CN_OCC_RES * (size_t)z));
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++)
        if (occ->seen[c] < 0) occ->corners[c >> 5] &= ~(1u << (c & 31));
}

void cn_occupancy_close(cn_occupancy *occ)
{
    note_corners(occ, occ->bits);
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++) {
        if (!(occ->corners[c >> 5] >> (c & 31) & 1)) continue;
        occ->seen[c] = REFILLED;
        set_bit(occ, c);
    }
}

void cn_occupancy_shown(const cn_occupancy *occ, uint32_t step, uint32_t *bits)
{
    memcpy(bits, occ->bits, sizeof *bits * (CN_OCC_CELLS / 32));
    if (step < SETTLED) return;
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++)
        if (is_unproven(occ->seen[c])) bits[c >> 5] &= ~(1u << (c & 31));
    note_corners(occ, bits);
    for (uint32_t w = 0; w < CN_OCC_CELLS / 32; w++)
        bits[w] |= occ->corners[w];
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
