/* A hole in a surface is opened for a ray that falls through it, and nothing else is. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "train/trainer.h"

#include <string.h>

enum { SLAB = 64, HOLE_X = 66, HOLE_Y = 61 };

typedef struct rig {
    cn_trainer t;
    cn_ray ray;
    float dir[3];
    uint8_t hole;
} rig;

static uint32_t cell_of(uint32_t x, uint32_t y, uint32_t z)
{
    return x + CN_OCC_RES * (y + CN_OCC_RES * z);
}
static bool full(const rig *r, uint32_t cell)
{
    return r->t.occ.bits[cell >> 5] >> (cell & 31) & 1;
}
static uint32_t count(const rig *r)
{
    uint32_t n = 0;
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++)
        n += full(r, c);
    return n;
}

/* A slab of full cells across all space with one cell missing, and a ray down through that one. */
static void rig_init(rig *r)
{
    memset(r, 0, sizeof *r);
    cn_arena counter;
    cn_arena_count(&counter);
    cn_occupancy_take(&r->t.occ, &counter);
    assert_int_equal(cn_arena_init(&r->t.arena, counter.used), CN_OK);
    cn_occupancy_take(&r->t.occ, &r->t.arena);
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++)
        r->t.occ.seen[c] = c / (CN_OCC_RES * CN_OCC_RES) == SLAB;
    r->t.occ.seen[cell_of(HOLE_X, HOLE_Y, SLAB)] = 0;
    cn_occupancy_restore(&r->t.occ);
    r->t.box = (cn_box){ .near_m = 0.1f, .far_m = 50 };
    r->t.options.steps = 100;
    r->t.step = 50;
    r->t.n_rays = 1;
    r->t.rays = &r->ray;
    r->t.dirs = r->dir;
    r->t.ray_hole = &r->hole;
    r->ray.box_ray =
        (cn_box_ray){ .origin = { (HOLE_X + 0.5f) / 32 - 2, (HOLE_Y + 0.5f) / 32 - 2, 0.9f }, .dir = { 0, 0, -1 } };
    r->dir[2] = -1;
}

static void rig_deinit(rig *r)
{
    cn_arena_deinit(&r->t.arena);
}

static void test_a_hole_is_opened(void **state)
{
    (void)state;
    rig r;
    rig_init(&r);
    const uint32_t before = count(&r);
    cn_reopen_note(&r.t, 0, 0.2f); /* something was there */
    cn_reopen_cells(&r.t);
    assert_int_equal(count(&r), before);
    cn_reopen_note(&r.t, 0, 0.9f);
    cn_reopen_cells(&r.t);
    assert_true(full(&r, cell_of(HOLE_X, HOLE_Y, SLAB)));
    assert_int_equal(count(&r), before + 1);
    rig_deinit(&r);
}

/* Not where only one photo sees, not before there are surfaces, not in the sky. */
static void test_nothing_else_is(void **state)
{
    (void)state;
    rig r;
    rig_init(&r);
    const uint32_t before = count(&r);
    r.t.occ.seen[cell_of(HOLE_X, HOLE_Y, SLAB)] = -1;
    cn_reopen_note(&r.t, 0, 1);
    cn_reopen_cells(&r.t);
    assert_int_equal(count(&r), before);
    r.t.occ.seen[cell_of(HOLE_X, HOLE_Y, SLAB)] = 0;
    r.t.step = 2;
    cn_reopen_cells(&r.t);
    assert_int_equal(count(&r), before);
    r.t.step = 50;
    r.t.pack.background.n = 1;
    r.dir[2] = 1;
    cn_reopen_note(&r.t, 0, 1);
    cn_reopen_cells(&r.t);
    assert_int_equal(count(&r), before);
    rig_deinit(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_hole_is_opened),
        cmocka_unit_test(test_nothing_else_is),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
