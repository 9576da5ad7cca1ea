/* A ray that falls through a hole in a surface opens the hole's cell, and no other cell. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "effect/sky_hints.h"
#include "train/reactivation.h"

#include <string.h>

enum { SLAB = 64, HOLE_X = 66, HOLE_Y = 61 };

typedef struct rig {
    cn_reactivation reactivation;
    cn_batch batch;
    cn_box box;
    cn_occupancy occ;
    cn_arena arena;
    cn_step_at at;
    bool sky;
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
    return r->occ.bits[cell >> 5] >> (cell & 31) & 1;
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
    cn_occupancy_take(&r->occ, &counter);
    assert_int_equal(cn_arena_init(&r->arena, counter.used), CN_OK);
    cn_occupancy_take(&r->occ, &r->arena);
    for (uint32_t c = 0; c < CN_OCC_CELLS; c++)
        r->occ.seen[c] = c / (CN_OCC_RES * CN_OCC_RES) == SLAB;
    r->occ.seen[cell_of(HOLE_X, HOLE_Y, SLAB)] = 0;
    cn_occupancy_restore(&r->occ);
    r->box = (cn_box){ .near_m = 0.1f, .far_m = 50 };
    r->at = (cn_step_at){ 750, 1500 };
    r->batch.n_rays = 1;
    r->batch.rays = &r->ray;
    r->batch.dirs = r->dir;
    r->reactivation.missing = &r->hole;
    r->ray.box_ray =
        (cn_box_ray){ .origin = { (HOLE_X + 0.5f) / 32 - 2, (HOLE_Y + 0.5f) / 32 - 2, 0.9f }, .dir = { 0, 0, -1 } };
    r->dir[2] = -1;
}

static void rig_deinit(rig *r)
{
    cn_arena_deinit(&r->arena);
}

static void note(rig *r, float after)
{
    cn_reactivation_note(&r->reactivation, &r->batch, 0, after, r->sky);
}

static void open_cells(rig *r)
{
    cn_reactivation_open(&r->reactivation, &r->batch, &r->box, r->at, &r->occ);
}

static void test_a_hole_is_opened(void **state)
{
    (void)state;
    rig r;
    rig_init(&r);
    const uint32_t before = count(&r);
    note(&r, 0.2f); /* something was there */
    open_cells(&r);
    assert_int_equal(count(&r), before);
    note(&r, 0.9f);
    open_cells(&r);
    assert_true(full(&r, cell_of(HOLE_X, HOLE_Y, SLAB)));
    assert_int_equal(count(&r), before + 1);
    rig_deinit(&r);
}

/* No cell is opened where only one photo sees, before there are surfaces, late in a long schedule, or in the sky. */
static void test_nothing_else_is(void **state)
{
    (void)state;
    rig r;
    rig_init(&r);
    const uint32_t before = count(&r);
    r.occ.seen[cell_of(HOLE_X, HOLE_Y, SLAB)] = -1;
    note(&r, 1);
    open_cells(&r);
    assert_int_equal(count(&r), before);
    r.occ.seen[cell_of(HOLE_X, HOLE_Y, SLAB)] = 0;
    r.at.step = 30;
    open_cells(&r);
    assert_int_equal(count(&r), before);
    r.at = (cn_step_at){ 4500, 6000 }; /* what a photo shows leads no more */
    open_cells(&r);
    assert_int_equal(count(&r), before);
    r.at = (cn_step_at){ 750, 1500 };
    r.sky = true;
    r.dir[2] = 1;
    note(&r, 1);
    open_cells(&r);
    assert_int_equal(count(&r), before);
    rig_deinit(&r);
}

/* A ray upwards may end in the sky, but not where the photo shows a wall. */
static void test_a_wall_above_the_horizon_is_opened(void **state)
{
    (void)state;
    rig r;
    rig_init(&r);
    const uint32_t before = count(&r);
    uint8_t sky_hint = CN_SKY_UNKNOWN;
    r.batch.sky_hint = &sky_hint;
    r.sky = true;
    r.dir[2] = 1;
    r.ray.box_ray.origin[2] = -0.9f;
    r.ray.box_ray.dir[2] = 1;
    note(&r, 1);
    open_cells(&r);
    assert_int_equal(count(&r), before);
    sky_hint = CN_SKY_NONE;
    note(&r, 1);
    open_cells(&r);
    assert_int_equal(count(&r), before + 1);
    rig_deinit(&r);
}

/* Each part of the empty cells, twice in a long schedule, and only where the march has samples to spare. */
static void test_cells_are_filled_again_where_there_is_room(void **state)
{
    (void)state;
    for (uint32_t steps = 3000; steps <= 48000; steps *= 2) {
        uint32_t times[CN_REFILL_PARTS] = { 0 }, first = steps, last = 0, part;
        for (uint32_t step = 0; step < steps; step++) {
            if (!cn_reactivation_refills((cn_step_at){ step, steps }, &part)) continue;
            assert_in_range(part, 0, CN_REFILL_PARTS - 1);
            times[part]++;
            last = step;
            if (first == steps) first = step;
        }
        for (part = 0; part < CN_REFILL_PARTS; part++)
            assert_int_equal(times[part], 2);
        assert_in_range(first, 0.3 * steps - 1, 0.3 * steps + 1);
        assert_in_range(last, steps / 2, 0.6 * steps);
    }
    uint32_t none;
    for (uint32_t step = 0; step < 1500; step++)
        assert_false(cn_reactivation_refills((cn_step_at){ step, 1500 }, &none));
    const double shortest = 0.0078125;
    cn_sampler s = { .pace = { .march_step = shortest } };
    const cn_step_at at = { 1800, 6000 };
    assert_true(cn_sampler_has_room(&s, 12, at, false, shortest));
    assert_false(cn_sampler_has_room(&s, 19, at, false, shortest));
    assert_true(cn_sampler_has_room(&s, 19, at, true, shortest)); /* where poses move, a ray may have more */
    s.pace.march_step = 2 * shortest;
    assert_false(cn_sampler_has_room(&s, 12, at, false, shortest));
}

/* In the last fifth of every schedule, so that what is in them is still learned. */
static void test_corners_are_filled_near_the_end(void **state)
{
    (void)state;
    for (uint32_t steps = 1500; steps <= 48000; steps *= 2) {
        uint32_t times = 0, first = steps;
        for (uint32_t step = 0; step < steps; step++) {
            if (!cn_reactivation_closes((cn_step_at){ step, steps })) continue;
            if (!times++) first = step;
        }
        assert_in_range(first, 0.8 * steps, 0.8 * steps + 32);
        assert_in_range(times, 0.2 * steps / 32 - 1, 0.2 * steps / 32 + 1);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_hole_is_opened),
        cmocka_unit_test(test_nothing_else_is),
        cmocka_unit_test(test_a_wall_above_the_horizon_is_opened),
        cmocka_unit_test(test_cells_are_filled_again_where_there_is_room),
        cmocka_unit_test(test_corners_are_filled_near_the_end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
