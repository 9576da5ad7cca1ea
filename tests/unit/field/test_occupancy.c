/* Which cells a march goes through, and which a render shows. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "field/occupancy.h"

#include <stdlib.h>
#include <string.h>

enum { UNUSABLE, UNVISITED, EMPTY, FULL, RARE };
#define DECAY 0.85f

static bool has(const uint32_t *bits, uint32_t cell)
{
    return bits[cell >> 5] >> (cell & 31) & 1;
}

/* Every cell is full at first, but UNUSABLE. */
static void begin(cn_occupancy *occ)
{
    *occ = (cn_occupancy){ malloc(sizeof(float) * CN_OCC_CELLS), malloc(sizeof(uint32_t) * CN_OCC_CELLS),
                           malloc(sizeof(uint32_t) * (CN_OCC_CELLS / 32)),
                           malloc(sizeof(uint32_t) * (CN_OCC_CELLS / 32)) };
    uint8_t *usable = malloc(CN_OCC_CELLS);
    assert_true(occ->seen && occ->visited && occ->bits && occ->corners && usable);
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++)
        usable[c] = c != UNUSABLE;
    cn_occupancy_reset(occ, usable);
    free(usable);
}

static void end(cn_occupancy *occ)
{
    free(occ->seen);
    free(occ->visited);
    free(occ->bits);
    free(occ->corners);
}

static void visit(cn_occupancy *occ, uint32_t steps)
{
    for (uint32_t step = 1; step <= steps; step++)
        cn_occupancy_update(occ, step, DECAY, 2, (uint32_t[2]){ EMPTY, FULL }, (float[2]){ 0, 1 });
}

/* A cell that training never visits, or so seldom that it is not empty yet, is full for the march. A render does not
 * show it, also after a resume. */
static void test_cells_without_proof_are_not_shown(void **state)
{
    (void)state;
    cn_occupancy occ;
    begin(&occ);
    uint32_t *shown = malloc(sizeof *shown * (CN_OCC_CELLS / 32));
    assert_non_null(shown);
    visit(&occ, 1);
    assert_true(has(occ.bits, EMPTY)); /* one visit does not empty a cell */
    visit(&occ, 40);
    for (uint32_t step = 42; step < 45; step++)
        cn_occupancy_update(&occ, step, DECAY, 1, (uint32_t[1]){ RARE }, (float[1]){ 0 });
    for (int resumed = 0; resumed < 2; resumed++) {
        cn_occupancy_shown(&occ, 500, shown);
        assert_false(has(occ.bits, UNUSABLE) || has(shown, UNUSABLE));
        assert_true(has(occ.bits, UNVISITED));
        assert_false(has(shown, UNVISITED));
        assert_false(has(occ.bits, EMPTY) || has(shown, EMPTY));
        assert_true(has(occ.bits, FULL) && has(shown, FULL));
        assert_true(has(occ.bits, RARE));
        assert_false(has(shown, RARE));
        cn_occupancy_restore(&occ);
    }
    cn_occupancy_update(&occ, 46, DECAY, 1, (uint32_t[1]){ RARE }, (float[1]){ 0.1f });
    cn_occupancy_shown(&occ, 499, shown);
    assert_true(has(shown, UNVISITED)); /* too early to tell */
    cn_occupancy_shown(&occ, 500, shown);
    assert_true(has(shown, RARE));
    end(&occ);
    free(shown);
}

/* A short schedule needs the fog gone soon; a long one leaves a surface more visits to form in. */
static void test_a_long_schedule_empties_later(void **state)
{
    (void)state;
    cn_occupancy occ;
    const uint32_t steps[] = { 100, 1500, 6000, 20000 };
    uint32_t visits[4] = { 0 };
    for (int s = 0; s < 4; s++) {
        begin(&occ);
        while (has(occ.bits, EMPTY) && visits[s] < 1000) {
            const float decay = cn_occupancy_decay(steps[s]);
            cn_occupancy_update(&occ, ++visits[s], decay, 1, (uint32_t[1]){ EMPTY }, (float[1]){ 0 });
        }
        end(&occ);
    }
    assert_int_equal(visits[0], 26);
    assert_int_equal(visits[1], 26);
    assert_int_equal(visits[2], 52);
    assert_in_range(visits[3], 90, 100);
}

/* What looked empty is looked at once more, but is not shown until something is found there. */
static void test_empty_cells_are_filled_again(void **state)
{
    (void)state;
    cn_occupancy occ;
    begin(&occ);
    uint32_t *shown = malloc(sizeof *shown * (CN_OCC_CELLS / 32));
    assert_non_null(shown);
    visit(&occ, 60);
    assert_false(has(occ.bits, EMPTY));
    const float full = occ.seen[FULL], unvisited = occ.seen[UNVISITED];
    cn_occupancy_refill(&occ, 0, 1);
    assert_true(has(occ.bits, EMPTY));
    assert_false(has(occ.bits, UNUSABLE));
    assert_true(occ.seen[FULL] == full && occ.seen[UNVISITED] == unvisited);
    cn_occupancy_shown(&occ, 1000, shown);
    assert_false(has(shown, EMPTY));
    for (uint32_t step = 61; step < 90; step++)
        cn_occupancy_update(&occ, step, DECAY, 1, (uint32_t[1]){ EMPTY }, (float[1]){ 0 });
    assert_false(has(occ.bits, EMPTY)); /* and is empty again where nothing is found */
    cn_occupancy_refill(&occ, 0, 1);
    cn_occupancy_update(&occ, 90, DECAY, 1, (uint32_t[1]){ EMPTY }, (float[1]){ 0.5f });
    cn_occupancy_shown(&occ, 1000, shown);
    assert_true(has(shown, EMPTY));
    end(&occ);
    free(shown);
}

/* Each cell is in one part, a part is about as large as another, and cells beside each other are mostly in one. */
static void test_parts_fill_the_grid(void **state)
{
    (void)state;
    enum { PARTS = 16 };
    cn_occupancy occ;
    begin(&occ);
    uint32_t before = 0, together = 0;
    for (uint32_t part = 0; part < PARTS; part++) {
        for (uint32_t c = 0; c < CN_OCC_CELLS; c++)
            occ.seen[c] = 0;
        cn_occupancy_restore(&occ);
        cn_occupancy_refill(&occ, part, PARTS);
        uint32_t filled = 0;
        for (uint32_t c = 0; c < CN_OCC_CELLS; c++) {
            filled += has(occ.bits, c);
            together += c && has(occ.bits, c) && has(occ.bits, c - 1);
        }
        assert_in_range(filled, CN_OCC_CELLS / PARTS / 2, CN_OCC_CELLS / PARTS * 2);
        before += filled;
    }
    assert_int_equal(before, CN_OCC_CELLS);
    assert_true(together > CN_OCC_CELLS / 8 * 7);
    end(&occ);
}

static bool full_at(const uint32_t *bits, const int c[3], const int d[3])
{
    uint32_t cell = 0;
    for (int a = 2; a >= 0; a--) {
        if (c[a] + d[a] < 0 || c[a] + d[a] >= CN_OCC_RES) return false;
        cell = cell * CN_OCC_RES + (uint32_t)(c[a] + d[a]);
    }
    return has(bits, cell);
}

/* By the definition: at one of the cell's twelve edges, only the two cells beside it that share a face with it are
 * full. */
static bool is_corner(const uint32_t *bits, const int c[3])
{
    if (full_at(bits, c, (const int[3]){ 0 })) return false;
    for (int x = -1; x <= 1; x++)
        for (int y = -1; y <= 1; y++)
            for (int z = -1; z <= 1; z++) {
                if (x * x + y * y + z * z != 2) continue;
                const int axes[3][3] = { { x, 0, 0 }, { 0, y, 0 }, { 0, 0, z } };
                bool both = !full_at(bits, c, (const int[3]){ x, y, z });
                for (int a = 0; a < 3; a++)
                    both = both && ((const int[3]){ x, y, z }[a] == 0 || full_at(bits, c, axes[a]));
                if (both) return true;
            }
    return false;
}

/* One cell in a few is full, also at the grid's faces and at the borders of words. Those that are filled are the
 * corners as they were, and no cell of no use. A render shows the same. */
static void test_corners_are_filled(void **state)
{
    (void)state;
    cn_occupancy occ;
    begin(&occ);
    uint32_t *before = malloc(sizeof *before * (CN_OCC_CELLS / 32)),
             *shown = malloc(sizeof *shown * (CN_OCC_CELLS / 32));
    assert_true(before && shown);
    uint32_t random = 1, filled = 0, unusable = 0;
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++) {
        random = random * 1664525u + 1013904223u;
        occ.seen[c] = random >> 29 == 0 ? 1 : random >> 29 == 1 ? -1 : 0;
    }
    cn_occupancy_restore(&occ);
    memcpy(before, occ.bits, sizeof *before * (CN_OCC_CELLS / 32));
    cn_occupancy_shown(&occ, 1000, shown);
    cn_occupancy_close(&occ);
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++) {
        const int at[3] = { (int)(c % CN_OCC_RES), (int)(c / CN_OCC_RES % CN_OCC_RES),
                            (int)(c / (CN_OCC_RES * CN_OCC_RES)) };
        const bool corner = is_corner(before, at), fills = corner && occ.seen[c] >= 0;
        if (has(occ.bits, c) != (has(before, c) || fills) || has(shown, c) != has(occ.bits, c))
            fail_msg("cell %d, %d, %d", at[0], at[1], at[2]);
        filled += fills;
        unusable += corner && occ.seen[c] < 0;
    }
    assert_true(filled > CN_OCC_CELLS / 100 && unusable > CN_OCC_CELLS / 1000);
    memcpy(before, occ.bits, sizeof *before * (CN_OCC_CELLS / 32));
    cn_occupancy_restore(&occ); /* a resume has them too */
    assert_memory_equal(before, occ.bits, sizeof *before * (CN_OCC_CELLS / 32));
    end(&occ);
    free(before);
    free(shown);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_cells_without_proof_are_not_shown),
                                        cmocka_unit_test(test_a_long_schedule_empties_later),
                                        cmocka_unit_test(test_empty_cells_are_filled_again),
                                        cmocka_unit_test(test_parts_fill_the_grid),
                                        cmocka_unit_test(test_corners_are_filled) };
    return cmocka_run_group_tests_name("occupancy", tests, NULL, NULL);
}
