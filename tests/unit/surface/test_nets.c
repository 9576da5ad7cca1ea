/* Surface nets on distances that the test writes into the lattice. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "surface/nets.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* One block, in which distance(place) is known everywhere. */
static void fill(cn_fusion *f, double (*distance)(const int32_t at[3]))
{
    const int32_t block[3] = { 0, 0, 0 };
    *f = (cn_fusion){ .cube_m = 0.1 };
    assert_int_equal(cn_fusion_add(f, block, true), CN_OK);
    for (int32_t i = 0; i < CN_LATTICE_POINTS; i++) {
        const int32_t at[3] = { i % CN_LATTICE_SIDE, i / CN_LATTICE_SIDE % CN_LATTICE_SIDE,
                                i / (CN_LATTICE_SIDE * CN_LATTICE_SIDE) };
        f->blocks[0].distance[i] = (float)distance(at);
        f->blocks[0].weight[i] = 1;
        f->blocks[0].seen[i] = 3;
    }
}

static double from_a_point(const int32_t at[3])
{
    return sqrt((at[0] - 3) * (at[0] - 3) + (at[1] - 4) * (at[1] - 4) + (at[2] - 4) * (at[2] - 4)) / CN_LATTICE_BAND;
}

/* Zero on an edge of the lattice, along x. */
static double from_a_line(const int32_t at[3])
{
    return sqrt((at[1] - 4) * (at[1] - 4) + (at[2] - 4) * (at[2] - 4)) / CN_LATTICE_BAND;
}

static double from_a_slope(const int32_t at[3])
{
    return (at[0] + at[1] + at[2] - 12.0) / (sqrt(3) * CN_LATTICE_BAND);
}

/* Where the surface passes through points of the lattice, the vertices of the cubes around them stay apart, in float at
 * the distance of a city's border. They move by less than a twentieth of a cube. */
static void no_two_vertices_are_at_one_place(void **state)
{
    (void)state;
    double (*const shapes[])(const int32_t[3]) = { from_a_point, from_a_line, from_a_slope };
    for (int s = 0; s < 3; s++) {
        cn_fusion f;
        cn_nets nets = { .least_seen = 1 };
        fill(&f, shapes[s]);
        assert_int_equal(cn_nets_find(&nets, &f), CN_OK);
        assert_true(nets.n >= 8);
        for (uint32_t a = 0; a < nets.n; a++)
            for (uint32_t b = 0; b < a; b++) {
                float apart = 0;
                for (int k = 0; k < 3; k++)
                    apart = fmaxf(apart, fabsf((nets.vertices[a].xyz[k] + 1000) - (nets.vertices[b].xyz[k] + 1000)));
                assert_true(apart > 0);
            }
        for (uint32_t a = 0; a < nets.n && s == 2; a++) {
            const float *p = nets.vertices[a].xyz;
            assert_true(fabsf(p[0] + p[1] + p[2] - 1.2F) / sqrtf(3) < 0.005F);
        }
        cn_nets_deinit(&nets);
        cn_fusion_deinit(&f);
    }
}

static double from_nothing(const int32_t at[3])
{
    (void)at;
    return 1;
}

/* A city's first region may be empty: it adds nothing, and the regions after it are as they were. */
static void a_region_without_a_surface_adds_nothing(void **state)
{
    (void)state;
    double (*const shapes[])(const int32_t[3]) = { from_nothing, from_a_slope, from_nothing };
    cn_triangles triangles;
    assert_int_equal(cn_triangles_open(&triangles, "."), CN_OK);
    cn_nets nets = { .triangles = &triangles, .least_seen = 1 };
    for (int s = 0; s < 3; s++) {
        cn_fusion f;
        fill(&f, shapes[s]);
        assert_int_equal(cn_nets_find(&nets, &f), CN_OK);
        assert_int_equal(cn_nets_add(&nets, &f), CN_OK);
        assert_true(s ? triangles.n_vertices > 8 && triangles.n_triangles > 0 : triangles.n_vertices == 0);
        cn_fusion_deinit(&f);
    }
    cn_nets_deinit(&nets);
    cn_triangles_close(&triangles);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(no_two_vertices_are_at_one_place),
                                        cmocka_unit_test(a_region_without_a_surface_adds_nothing) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
