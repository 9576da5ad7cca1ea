/* Which cells of a tile may hold matter. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "field/occupancy.h"
#include "math/linalg.h"
#include "rays/rays.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const cn_box box = { { 0, 0, 0 }, { 10, 10, 10 }, 0.1f, 100, 0.01f };

/* A camera at (0, -10, 0) that looks north or south, level. */
static cn_ray_generator looking(double north)
{
    const cn_camera camera = { .lens = CN_LENS_PINHOLE, .width = 40, .height = 40, .params = { 40, 40, 20, 20 } };
    const cn_view view = { .rotation = { north, 0, 0, 0, 0, -1, 0, north, 0 }, .translation = { 0, 0, 10 * north } };
    cn_ray_generator generator;
    cn_ray_generator_init(&generator, &camera, &view, &box);
    return generator;
}

/* Usable cells, and those of them nearer than `near` to the first camera. */
static uint32_t usable_cells(uint32_t n, const float *from_m, double near, uint32_t *n_near)
{
    const cn_ray_generator generators[2] = { looking(1), looking(-1) };
    float alone_from_m[2 * CN_ALONE_PARTS];
    uint8_t *usable = malloc(CN_OCC_CELLS);
    assert_non_null(usable);
    for (int i = 0; i < 2 * CN_ALONE_PARTS; i++)
        alone_from_m[i] = from_m[i / CN_ALONE_PARTS];
    const cn_seeing_views views = { n, generators, alone_from_m };
    assert_true(cn_rays_visible_cells(NULL, &box, &views, usable));
    uint32_t count = 0;
    *n_near = 0;
    for (uint32_t i = 0; i < CN_OCC_CELLS; i++) {
        float x[3];
        cn_occupancy_centre(i, x);
        const double y = 10 * (double)x[1] + 10;
        count += usable[i];
        *n_near +=
            usable[i] && sqrt(100 * (double)x[0] * (double)x[0] + y * y + 100 * (double)x[2] * (double)x[2]) < near;
    }
    free(usable);
    return count;
}

static void test_one_view_from_its_distance_on(void **state)
{
    (void)state;
    uint32_t near;
    const float never[2] = { INFINITY, INFINITY }, from_8[2] = { 8, INFINITY };
    /* A single view makes every cell usable that it sees. */
    const uint32_t alone = usable_cells(1, never, 7.9, &near);
    assert_true(alone > 0 && near > 0);
    /* Two views that see different places do not support each other. */
    assert_int_equal(usable_cells(2, never, 7.9, &near), 0);
    /* Beyond 8 m, the first view needs no second one. */
    const uint32_t far = usable_cells(2, from_8, 7.9, &near);
    assert_int_equal(near, 0);
    assert_true(far > alone / 2 && far < alone);
}

/* The left half of the picture is known from 4 m on, the right one from 12 m on. */
static void test_parts_of_a_picture(void **state)
{
    (void)state;
    const cn_ray_generator generators[2] = { looking(1), looking(-1) };
    float alone_from_m[2 * CN_ALONE_PARTS];
    uint32_t left = 0, right = 0;
    for (int i = 0; i < 2 * CN_ALONE_PARTS; i++)
        alone_from_m[i] = i >= CN_ALONE_PARTS ? INFINITY : i % CN_ALONE_X < CN_ALONE_X / 2 ? 4 : 12;
    uint8_t *usable = malloc(CN_OCC_CELLS);
    assert_non_null(usable);
    assert_true(cn_rays_visible_cells(NULL, &box, &(cn_seeing_views){ 2, generators, alone_from_m }, usable));
    for (uint32_t i = 0; i < CN_OCC_CELLS; i++) {
        float x[3];
        cn_occupancy_centre(i, x);
        const double at[3] = { 10 * (double)x[0], 10 * (double)x[1] + 10, 10 * (double)x[2] };
        if (!usable[i]) continue;
        assert_true(sqrt(cn_dot3(at, at)) >= (x[0] < 0 ? 4 : 12));
        if (sqrt(cn_dot3(at, at)) < 12) left += x[0]<0, right += x[0]> 0;
    }
    assert_true(left > 0 && right == 0);
    free(usable);
}

/* Two views that look south are as good among very many that look north as they are alone. */
static void test_few_views_among_many(void **state)
{
    (void)state;
    enum { MANY = 2048 };
    cn_ray_generator *generators = malloc(sizeof *generators * MANY);
    uint8_t *usable = malloc(2 * (size_t)CN_OCC_CELLS), *alone = usable + CN_OCC_CELLS;
    assert_true(generators && usable);
    for (int i = 0; i < MANY; i++)
        generators[i] = looking(i == 701 || i == 1403 ? -1 : 1);
    assert_true(cn_rays_visible_cells(NULL, &box, &(cn_seeing_views){ .n = MANY, .generators = generators }, usable));
    generators[0] = generators[1] = looking(-1);
    assert_true(cn_rays_visible_cells(NULL, &box, &(cn_seeing_views){ .n = 2, .generators = generators }, alone));
    uint32_t south = 0;
    for (uint32_t i = 0; i < CN_OCC_CELLS; i++) {
        south += alone[i];
        assert_true(usable[i] || !alone[i]);
    }
    assert_true(south > 0);
    free(generators);
    free(usable);
}

/* What cn_rays_visible_cells promises, cell by cell and view by view, with a margin of that share of the picture. */
static bool is_usable(const cn_seeing_views *views, uint32_t cell, double margin)
{
    float x[3];
    uint32_t seen = 0;
    cn_occupancy_centre(cell, x);
    for (uint32_t i = 0; i < views->n; i++) {
        const cn_ray_generator *g = &views->generators[i];
        const double w = g->camera.width, h = g->camera.height;
        double rel[3], cam[3], px[2];
        for (int a = 0; a < 3; a++)
            rel[a] = (double)x[a] * box.half_extent[a] - g->origin[a];
        cn_mat3_tvec(g->world_from_cam, rel, cam);
        if (!cn_camera_project(&g->camera, cam, px)) continue;
        if (px[0] <= -margin * w || px[1] <= -margin * h || px[0] >= (1 + margin) * w || px[1] >= (1 + margin) * h)
            continue;
        if (sqrt(cn_dot3(cam, cam)) >= (double)views->alone_from_m[i * CN_ALONE_PARTS]) return true;
        seen++;
    }
    return seen >= 2;
}

/* Views of every kind of lens, near to each other and far apart, one of them outside the box. */
static void test_no_cell_is_missed(void **state)
{
    (void)state;
    static const cn_camera cameras[] = {
        { .lens = CN_LENS_PINHOLE, .width = 60, .height = 40, .params = { 50, 45, 30, 20 } },
        { .lens = CN_LENS_SIMPLE_RADIAL, .width = 60, .height = 40, .params = { 30, 30, 20, -0.2 } },
        { .lens = CN_LENS_SIMPLE_RADIAL, .width = 60, .height = 40, .params = { 30, 31, 18, 0.15 } },
        { .lens = CN_LENS_OPENCV, .width = 60, .height = 40, .params = { 40, 40, 33, 17, -0.3, 0.1, 0.01, -0.02 } },
        { .lens = CN_LENS_OPENCV_FISHEYE, .width = 60, .height = 60, .params = { 16, 16, 30, 30, 0.05, -0.01 } },
        { .lens = CN_LENS_PINHOLE, .width = 20, .height = 60, .params = { 200, 200, 10, 30 } },
        { .lens = CN_LENS_EQUIRECTANGULAR, .width = 60, .height = 30, .params = { 60, 30 } },
    };
    enum { VIEWS = sizeof cameras / sizeof *cameras };
    cn_ray_generator generators[VIEWS];
    float alone_from_m[VIEWS * CN_ALONE_PARTS];
    for (int i = 0; i < VIEWS; i++) {
        const double yaw = 2.1 * i, pitch = 0.35 * sin(5.0 * i), at[3] = { 9 * sin(3.0 * i), 14 * cos(4.0 * i), i % 3 };
        const double c = cos(yaw), s = sin(yaw), cp = cos(pitch), sp = sin(pitch);
        cn_view view = { .rotation = { c, s, 0, s * sp, -c * sp, -cp, -s * cp, c * cp, -sp } };
        double t[3];
        cn_mat3_vec(view.rotation, at, t);
        for (int a = 0; a < 3; a++)
            view.translation[a] = -t[a];
        cn_ray_generator_init(&generators[i], &cameras[i], &view, &box);
        for (int part = 0; part < CN_ALONE_PARTS; part++)
            alone_from_m[i * CN_ALONE_PARTS + part] = i % 4 ? INFINITY : 25;
    }
    uint8_t *usable = malloc(CN_OCC_CELLS);
    assert_non_null(usable);
    /* Without the picture of all directions, which is the last and sees every cell, and with it. */
    for (uint32_t n = VIEWS - 1; n <= VIEWS; n++) {
        const cn_seeing_views views = { n, generators, alone_from_m };
        uint32_t count = 0;
        assert_true(cn_rays_visible_cells(NULL, &box, &views, usable));
        for (uint32_t cell = 0; cell < CN_OCC_CELLS; cell++) {
            /* Every 13th is compared: fisheye lenses are slow. The margin depends on the cell's size. */
            if (cell % 13 == 0 && (usable[cell] ? !is_usable(&views, cell, 0.02) : is_usable(&views, cell, 0)))
                fail_msg("%u views, cell %u: usable is %d", n, cell, usable[cell]);
            count += usable[cell];
        }
        assert_in_range(count, CN_OCC_CELLS / 20, CN_OCC_CELLS - CN_OCC_CELLS / 20);
    }
    free(usable);
}

/* Whether all of a grid of rays into the cell, two places of the map apart or less, end above the row. */
static bool is_above(const cn_ray_generator *g, uint32_t cell, double row)
{
    enum { POINTS = 5 };
    const uint32_t c[3] = { cell % CN_OCC_RES, cell / CN_OCC_RES % CN_OCC_RES, cell / (CN_OCC_RES * CN_OCC_RES) };
    for (uint32_t i = 0; i < POINTS * POINTS * POINTS; i++) {
        const uint32_t part[3] = { i % POINTS, i / POINTS % POINTS, i / (POINTS * POINTS) };
        double x[3], m = 0, cam[3], px[2];
        for (int a = 0; a < 3; a++) {
            x[a] = (c[a] + (double)part[a] / (POINTS - 1)) * 4 / CN_OCC_RES - 2;
            m = fmax(m, fabs(x[a]));
        }
        if (m >= 2) return false;
        for (int a = 0; a < 3; a++)
            x[a] = x[a] / (m > 1 ? m * (2 - m) : 1) * box.half_extent[a] - g->origin[a];
        cn_mat3_tvec(g->world_from_cam, x, cam);
        if (!cn_camera_project(&g->camera, cam, px)) return false;
        const double edge = 1e-9; /* a corner may lie on the picture's edge */
        if (!(px[0] >= -edge && px[0] <= g->camera.width + edge && px[1] >= -edge && px[1] < row)) return false;
    }
    return true;
}

/* Two views beside each other are clear in the upper half, and a third one is nowhere. */
static void test_clear_cells(void **state)
{
    (void)state;
    enum { SIDE = 40 };
    cn_ray_generator generators[3] = { looking(1), looking(1), looking(-1) };
    generators[1].origin[0] += 0.5;
    static uint8_t clearance[3][SIDE * SIDE];
    for (int i = 0; i < 2 * SIDE * SIDE; i++)
        clearance[i / (SIDE * SIDE)][i % (SIDE * SIDE)] =
            (uint8_t)(i / SIDE % SIDE < SIDE / 2 ? SIDE / 2 - i / SIDE % SIDE : 0);
    uint8_t *usable = malloc(CN_OCC_CELLS);
    assert_non_null(usable);
    memset(usable, 1, CN_OCC_CELLS);
    const cn_seeing_views views = { .n = 3, .generators = generators };
    const cn_clear_maps maps = { SIDE, SIDE, clearance[0] };
    assert_true(cn_rays_clear_cells(NULL, &box, &views, &maps, usable));
    uint32_t cleared = 0, could = 0;
    for (uint32_t cell = 0; cell < CN_OCC_CELLS; cell++) {
        const bool above = is_above(&generators[0], cell, SIDE / 2) && is_above(&generators[1], cell, SIDE / 2);
        if (!usable[cell] && !above) fail_msg("cell %u is cleared, and a view shows matter there", cell);
        cleared += !usable[cell];
        could += above;
    }
    /* Cells within some places of the edges are left, for safety. */
    assert_in_range(cleared, could / 3, could);
    /* One view alone is not enough when there are others. */
    memset(clearance[1], 0, sizeof clearance[1]);
    memset(usable, 1, CN_OCC_CELLS);
    assert_true(cn_rays_clear_cells(NULL, &box, &views, &maps, usable));
    assert_null(memchr(usable, 0, CN_OCC_CELLS));
    free(usable);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_one_view_from_its_distance_on),
                                        cmocka_unit_test(test_parts_of_a_picture),
                                        cmocka_unit_test(test_few_views_among_many),
                                        cmocka_unit_test(test_no_cell_is_missed), cmocka_unit_test(test_clear_cells) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
