/* Extreme cameras: lenses that see half of all directions, or whose distortion has no inverse; and cameras at places
 * where the tiles' weights could be 0 / 0. */
#include "hard.h"

#include "base/units.h"
#include "conurb/compose.h"
#include "math/linalg.h"
#include "rays/rays.h"

#include <math.h>
#include <string.h>

/* Makes the ray of every pixel and projects it back. It has length 1 and gives the same pixel. Returns how many pixels
 * have a ray. */
static unsigned there_and_back(const cn_camera *camera, double tolerance_px)
{
    unsigned n = 0;
    for (uint32_t y = 0; y < camera->height; y++)
        for (uint32_t x = 0; x < camera->width; x++) {
            double dir[3], back[2];
            hard_traps_on();
            const cn_status status = cn_camera_unproject(camera, x + 0.5, y + 0.5, dir);
            hard_traps_off();
            assert_true(fabs(cn_norm3(dir) - 1) < 1e-12);
            if (status != CN_OK) {
                assert_int_equal(status, CN_ERR_DATA);
                continue;
            }
            n++;
            hard_traps_on();
            const bool seen = cn_camera_project(camera, dir, back);
            hard_traps_off();
            assert_true(seen && hypot(back[0] - x - 0.5, back[1] - y - 0.5) < tolerance_px);
        }
    return n;
}

/* A fisheye that sees half of all directions, and one that sees nearly all. Rays to the side have z = 0; others point
 * backwards. Guard: angles come from atan2 (pose/project.c), never from x / z. With x / z the ray to the side is a
 * division by zero, and rays that point backwards are projected to the other side. */
static void test_fisheye(void **state)
{
    (void)state;
    const cn_camera half = { .id = 1,
                             .lens = CN_LENS_OPENCV_FISHEYE,
                             .width = 65,
                             .height = 65,
                             .params = { 65 / CN_PI, 65 / CN_PI, 32.5, 32.5 } };
    const cn_camera whole = { .id = 2,
                              .lens = CN_LENS_OPENCV_FISHEYE,
                              .width = 64,
                              .height = 64,
                              .params = { 32 / (0.98 * CN_PI), 32 / (0.98 * CN_PI), 32, 32, 0.01, -0.001, 0, 0 } };
    static const double side[3] = { 1, 0, 0 }, back[3] = { 0.1, 0, -1 }, axis[3] = { 0, 0, 1 },
                        behind[3] = { 0, 0, -1 };
    double px[2], dir[3];
    hard_traps_on();
    assert_true(cn_camera_project(&half, side, px) && fabs(px[0] - 65) < 1e-9 && fabs(px[1] - 32.5) < 1e-9);
    assert_true(cn_camera_project(&half, axis, px) && px[0] == 32.5);
    assert_true(cn_camera_project(&whole, back, px) && px[0] > 60 && px[0] < 66);
    assert_false(cn_camera_project(&whole, behind, px)); /* its side is not defined */
    assert_int_equal(cn_camera_unproject(&half, 65, 32.5, dir), CN_OK);
    assert_true(fabs(dir[2]) < 1e-12 && fabs(dir[0] - 1) < 1e-12);
    assert_int_equal(cn_camera_unproject(&half, 32.5, 32.5, dir), CN_OK);
    assert_true(dir[2] == 1);
    hard_traps_off();
    assert_int_equal(there_and_back(&half, 1e-9), 65 * 65); /* the rays of the corners point backwards by 37 degrees */
    assert_true(there_and_back(&whole, 1e-7) > 64 * 64 * 3 / 4);
}

/* Lenses whose distortion has no inverse everywhere. Where it has none, the function returns false, and the ray is
 * still finite. Where it has one, it is right. Guards: the limits of the radius and of the angle in pose/project.c, and
 * the limit of Newton's steps. Without the limit of the radius (in the inverse, or in the projection) two places of the
 * world share a pixel. */
static void test_no_inverse(void **state)
{
    (void)state;
    static const cn_camera lenses[] = {
        { .lens = CN_LENS_SIMPLE_RADIAL, .params = { 32, 32, 32, -0.5 } },
        { .lens = CN_LENS_RADIAL, .params = { 20, 32, 32, -0.4, 0.02 } },
        { .lens = CN_LENS_RADIAL, .params = { 20, 32, 32, 0.5, -0.4 } },
        { .lens = CN_LENS_OPENCV, .params = { 20, 20, 32, 32, -0.3, 0.05, 0.05, -0.08 } },
        { .lens = CN_LENS_OPENCV, .params = { 24, 24, 32, 32, -0.9, 0.4, 0.2, 0.3 } },
        { .lens = CN_LENS_OPENCV_FISHEYE, .params = { 20, 20, 32, 32, -0.2, 0.05, -0.02, -0.03 } },
        { .lens = CN_LENS_OPENCV_FISHEYE, .params = { 12, 12, 32, 32, -1, 0, 0, 0 } },
    };
    for (size_t i = 0; i < sizeof lenses / sizeof *lenses; i++) {
        cn_camera c = lenses[i];
        c.id = 1;
        c.width = c.height = 64;
        const unsigned n = there_and_back(&c, 1e-4);
        print_message("lens %zu: %u of 4096 pixels have a ray\n", i, n);
        assert_true(n > 60 && n < 4096);
    }
    /* Outside of the first lens's range, at a radius of 0.82. This is in no pixel, although the polynomial gives one.
     */
    cn_camera c = lenses[0];
    static const double past[3] = { 1.2, 0, 1 };
    double px[2];
    c.width = c.height = 64;
    assert_false(cn_camera_project(&c, past, px));
}

/* Training leaves out the rays of pixels without an inverse, and uses the others. Guard: where cn_ray_generator_ray
 * returns false, the pixel's weight becomes 0 (train/sampler.c). Without it training uses wrong rays. */
static void test_training_leaves_them_out(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    hard_run run;
    hard_scene_init(&synthetic, 3);
    synthetic.scene.cameras[0].lens = CN_LENS_SIMPLE_RADIAL;
    const double folded[8] = { 20, 24, 18, -0.6 };
    memcpy(synthetic.scene.cameras[0].params, folded, sizeof folded);
    const cn_train_options o = hard_options();
    hard_run_init(&run, &synthetic, &o, NULL);
    hard_must(cn_trainer_step(&run.t));
    uint32_t left_out = 0;
    for (uint32_t r = 0; r < run.t.batch.n_rays; r++) {
        if (run.t.batch.target[4 * (size_t)r + 3] > 0) continue;
        left_out++;
        assert_int_equal(run.t.batch.ray_samples[r], 0);
    }
    const double share = (double)left_out / run.t.batch.n_rays;
    print_message("%.0f %% of the rays left out\n", 100 * share);
    assert_true(share > 0.3 && run.t.stats.rays > 0);
    hard_run_deinit(&run);
    hard_train(&synthetic, &o);
    /* And a lens that sees half of all directions. */
    const double half[8] = { 48 / CN_PI, 48 / CN_PI, 24, 18 };
    synthetic.scene.cameras[0].lens = CN_LENS_OPENCV_FISHEYE;
    memcpy(synthetic.scene.cameras[0].params, half, sizeof half);
    assert_true(hard_train(&synthetic, &o).bad_rays == 0);
    synthetic_scene_deinit(&synthetic);
}

static cn_view looking(const double centre[3], const double right[3], const double down[3], const double forward[3])
{
    cn_view v = { 0 };
    memcpy(v.rotation, right, 3 * sizeof *right);
    memcpy(v.rotation + 3, down, 3 * sizeof *down);
    memcpy(v.rotation + 6, forward, 3 * sizeof *forward);
    cn_mat3_vec(v.rotation, centre, v.translation);
    for (int a = 0; a < 3; a++)
        v.translation[a] = -v.translation[a];
    return v;
}

static double sum_of(const cn_compose_choice *c)
{
    double sum = 0;
    for (uint32_t i = 0; i < c->n; i++)
        sum += c->weight[i];
    return sum;
}

/* A camera at the exact centre of a tile gets that tile. At the same distance from two tiles it gets half of each. Two
 * tiles with the same centre get half each. No weight is 0 / 0. Guard: `d == smallest ? 1 : smallest / d` in
 * compose/compose.c, twice (weights by picture, and by pixel). */
static void test_tile_centres(void **state)
{
    (void)state;
    static const double centres[3][3] = { { 0, 0, 0 }, { 100, 0, 0 }, { 0, 0, 7 } }, radii[3] = { 100, 100, 100 };
    static const double at_centre[3] = { 0, 0, 50 }, between[3] = { 50, 3, 2 };
    cn_compose_options o = cn_compose_options_default();
    cn_compose_choice c;
    for (int scheme = CN_BLEND_NEAREST; scheme <= CN_BLEND_OWNERSHIP; scheme++) {
        o.scheme = (cn_blend)scheme;
        hard_traps_on();
        cn_compose_choose(2, centres, radii, at_centre, &o, &c);
        hard_traps_off();
        assert_true(c.n >= 1 && c.tile[0] == 0 && c.weight[0] == 1 && c.coverage == 1);
        hard_traps_on();
        cn_compose_choose(2, centres, radii, between, &o, &c);
        hard_traps_off();
        assert_true(c.n == (scheme == CN_BLEND_NEAREST ? 1u : 2u));
        if (c.n == 2) assert_true(c.weight[0] == c.weight[1]);
        hard_traps_on();
        cn_compose_choose(3, centres, radii, at_centre, &o, &c);
        hard_traps_off();
        if (scheme == CN_BLEND_DISTANCE_2D) assert_true(c.n == 2 && c.weight[0] == 0.5 && fabs(sum_of(&c) - 1) < 1e-15);
    }
    double d[3] = { 0, 0, 5 };
    hard_traps_on();
    cn_compose_weights(3, d, 64, d);
    hard_traps_off();
    assert_true(d[0] == 0.5 && d[1] == 0.5 && d[2] == 0);
    double huge[3] = { 1e-300, 1e300, 1e-300 };
    hard_traps_on();
    cn_compose_weights(3, huge, 64, huge);
    hard_traps_off();
    assert_true(huge[0] == 0.5 && huge[1] == 0);
}

/* The same in a union of tiles: a picture of one pixel straight down from a centre (the ray never moves on the map),
 * straight along a face, and half way between two; the parts sum to 1. Guards: `fmaxf(2 * across, 1e-9)` and `dir != 0`
 * in render/union.c; without either the ray is a division by zero. */
static void test_union(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    hard_run run;
    hard_scene_init(&synthetic, 2);
    const cn_train_options o = hard_options();
    hard_run_init(&run, &synthetic, &o, NULL);
    hard_fill(&run, 3);
    cn_tile *tile = hard_tile(&run, &synthetic, 1.0 / 64);
    const cn_union_part parts[2] = { { .tile = tile, .blend_width_m = 1 },
                                     { .tile = tile, .centre_m = { 8, 0, 0 }, .blend_width_m = 1 } };
    static const double x[3] = { 1, 0, 0 }, y[3] = { 0, 1, 0 }, down[3] = { 0, 0, -1 }, south[3] = { 0, -1, 0 };
    static const double places[][3] = { { 0, 0, 4 }, { 4, 0, 4 }, { 0, 0, 0 }, { 4.5, 4.5, 4.5 }, { 8, 0, 2 } };
    const cn_camera camera = {
        .id = 1, .lens = CN_LENS_PINHOLE, .width = 1, .height = 1, .params = { 1, 1, 0.5, 0.5 }
    };
    const cn_context ctx = { 0 };
    const cn_render_options r = cn_render_options_default();
    for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
        const cn_view views[2] = { looking(places[i], x, south, down), looking(places[i], x, down, y) };
        for (int v = 0; v < 2; v++) {
            cn_picture p;
            float border;
            hard_must(cn_picture_init(&p, 1, 1));
            hard_traps_on();
            hard_must(cn_render_union(&ctx, &(cn_union){ 2, parts }, &camera, &views[v], &r,
                                      &(cn_union_output){ .picture = &p, .border = &border }));
            hard_traps_off();
            assert_true(p.rgba[3] > 0.99f && p.rgba[3] <= 1 && fabsf(p.rgba[0] - p.rgba[3]) < 2e-3f &&
                        p.depth[0] >= 0.9f);
            assert_true(border >= 0 && border <= 0.5f);
            cn_picture_deinit(&p);
        }
    }
    double share[2];
    static const double middle[2] = { 4, 0 }, at[2] = { 0, 0 };
    hard_traps_on();
    cn_union_shares(2, parts, middle, share);
    assert_true(share[0] == 0.5 && share[1] == 0.5);
    cn_union_shares(2, parts, at, share);
    assert_true(share[0] == 1 && share[1] == 0);
    hard_traps_off();
    cn_tile_close(&tile);
    hard_run_deinit(&run);
    synthetic_scene_deinit(&synthetic);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fisheye),
        cmocka_unit_test(test_no_inverse),
        cmocka_unit_test(test_training_leaves_them_out),
        cmocka_unit_test(test_tile_centres),
        cmocka_unit_test(test_union),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
