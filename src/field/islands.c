#include "field/islands.h"

#include <stdlib.h>
#include <string.h>

static bool take(uint32_t *bits, uint32_t cell)
{
    const uint32_t mask = (uint32_t)1 << (cell & 31);
    const bool full = bits[cell >> 5] & mask;
    bits[cell >> 5] &= ~mask;
    return full;
}

/* Takes the cells of the island that begins at cells[0] out of `left`, and lists them. Returns how many they are. */
static uint32_t list_island(uint32_t *left, const uint8_t *held, uint32_t *cells, bool *holds)
{
    uint32_t n = 1;
    *holds = false;
    for (uint32_t done = 0; done < n; done++) {
        const uint32_t c = cells[done];
        const int at[3] = { (int)(c % CN_OCC_RES), (int)(c / CN_OCC_RES % CN_OCC_RES),
                            (int)(c / (CN_OCC_RES * CN_OCC_RES)) };
        for (int i = 0; i < 27; i++) {
            const int x = at[0] + i % 3 - 1, y = at[1] + i / 3 % 3 - 1, z = at[2] + i / 9 - 1;
            if (x < 0 || y < 0 || z < 0 || x >= CN_OCC_RES || y >= CN_OCC_RES || z >= CN_OCC_RES) continue;
            const uint32_t next = (uint32_t)((z * CN_OCC_RES + y) * CN_OCC_RES + x);
            *holds = *holds || held[next];
            if (take(left, next)) cells[n++] = next;
        }
    }
    return n;
}

cn_status cn_islands_drop(uint32_t *bits, const uint8_t *held)
{
    const size_t size = sizeof *bits * (CN_OCC_CELLS / 32);
    uint32_t *left = malloc(size), *cells = malloc(sizeof *cells * CN_OCC_CELLS);
    const bool room = left && cells;
    if (room) memcpy(left, bits, size);
    for (uint32_t c = 0; c < CN_OCC_CELLS && room; c++) {
        if (!take(left, c)) continue;
        bool holds;
        cells[0] = c;
        const uint32_t n = list_island(left, held, cells, &holds);
        for (uint32_t i = 0; i < n && n < CN_ISLAND_LEAST && !holds; i++)
            (void)take(bits, cells[i]);
    }
    free(left);
    free(cells);
    return room ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for a tile's occupancy");
}
