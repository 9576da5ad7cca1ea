/* Small islands of full cells, which a render does not show. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "field/islands.h"

#include <stdlib.h>
#include <string.h>

typedef struct grid {
    uint32_t *bits;
    uint8_t *held;
} grid;

static grid make_grid(void)
{
    const grid g = { calloc(CN_OCC_CELLS / 32, sizeof *g.bits), calloc(CN_OCC_CELLS, 1) };
    assert_true(g.bits && g.held);
    return g;
}

static void free_grid(grid *g)
{
    free(g->bits);
    free(g->held);
}

static uint32_t cell_at(uint32_t x, uint32_t y, uint32_t z)
{
    return x + CN_OCC_RES * (y + CN_OCC_RES * z);
}

static void fill(grid *g, uint32_t cell)
{
    g->bits[cell >> 5] |= (uint32_t)1 << (cell & 31);
}

/* n cells along x. */
static void fill_row(grid *g, uint32_t n, uint32_t y, uint32_t z)
{
    for (uint32_t x = 0; x < n; x++)
        fill(g, cell_at(x, y, z));
}

static uint32_t count_row(const grid *g, uint32_t y, uint32_t z)
{
    uint32_t n = 0;
    for (uint32_t x = 0; x < CN_OCC_RES; x++)
        n += g->bits[cell_at(x, y, z) >> 5] >> (x & 31) & 1;
    return n;
}

static void test_small_islands_go(void **state)
{
    (void)state;
    grid g = make_grid();
    fill_row(&g, CN_ISLAND_LEAST - 1, 10, 10);
    fill_row(&g, CN_ISLAND_LEAST, 20, 20);
    fill_row(&g, CN_OCC_RES, CN_OCC_RES - 1, CN_OCC_RES - 1);
    fill(&g, cell_at(0, 0, 0)); /* the first cell of the grid; the last is in the row above */
    assert_int_equal(cn_islands_drop(g.bits, g.held), CN_OK);
    assert_int_equal(count_row(&g, 10, 10), 0);
    assert_int_equal(count_row(&g, 20, 20), CN_ISLAND_LEAST);
    assert_int_equal(count_row(&g, CN_OCC_RES - 1, CN_OCC_RES - 1), CN_OCC_RES);
    assert_int_equal(count_row(&g, 0, 0), 0);
    free_grid(&g);
}

enum { ROW = CN_ISLAND_LEAST - 1 }; /* too few alone, and enough with another row */

/* Two rows that touch at an edge are one island; so are two that touch at a corner. Rows with a gap are two, also where
 * one ends at a face of the grid and the next cell in memory is full. */
static void test_islands_touch_at_corners(void **state)
{
    (void)state;
    grid g = make_grid();
    fill_row(&g, ROW, 10, 10);
    fill_row(&g, ROW, 11, 11);
    fill_row(&g, ROW, 30, 30);
    for (uint32_t x = ROW; x < 2 * ROW; x++)
        fill(&g, cell_at(x, 31, 31));
    fill_row(&g, ROW, 50, 50);
    fill_row(&g, ROW, 52, 50);
    for (uint32_t x = CN_OCC_RES - ROW; x < CN_OCC_RES; x++)
        fill(&g, cell_at(x, 70, 70));
    fill_row(&g, ROW, 71, 70);
    assert_int_equal(cn_islands_drop(g.bits, g.held), CN_OK);
    assert_int_equal(count_row(&g, 10, 10) + count_row(&g, 11, 11), 2 * ROW);
    assert_int_equal(count_row(&g, 30, 30) + count_row(&g, 31, 31), 2 * ROW);
    assert_int_equal(count_row(&g, 50, 50) + count_row(&g, 52, 50), 0);
    assert_int_equal(count_row(&g, 70, 70) + count_row(&g, 71, 70), 0);
    free_grid(&g);
}

/* A sparse point in the island or beside it keeps it; one that is two cells away does not. */
static void test_sparse_points_keep_an_island(void **state)
{
    (void)state;
    grid g = make_grid();
    for (uint32_t y = 10; y < 50; y += 10)
        fill_row(&g, 3, y, 10);
    g.held[cell_at(1, 10, 10)] = 1;
    g.held[cell_at(3, 21, 11)] = 1;
    g.held[cell_at(4, 30, 10)] = 1;
    assert_int_equal(cn_islands_drop(g.bits, g.held), CN_OK);
    assert_int_equal(count_row(&g, 10, 10), 3);
    assert_int_equal(count_row(&g, 20, 10), 3);
    assert_int_equal(count_row(&g, 30, 10), 0);
    assert_int_equal(count_row(&g, 40, 10), 0);
    free_grid(&g);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_small_islands_go),
                                        cmocka_unit_test(test_islands_touch_at_corners),
                                        cmocka_unit_test(test_sparse_points_keep_an_island) };
    return cmocka_run_group_tests_name("islands", tests, NULL, NULL);
}
