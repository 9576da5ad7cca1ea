/* Splats of a ball before a sky, in views that the test draws. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "../surface/fixture.h"
#include "base/srgb.h"
#include "conurb/measure.h"
#include "conurb/splat.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { VIEWS = 14, SIDE = 64, BUDGET = 3000 };
#define RADIUS 4.0
#define NEAR 3.0 /* nearer than this, views show nothing */

static cn_camera camera = { .lens = CN_LENS_OPENCV, .width = SIDE, .height = SIDE, .params = { 52, 52, 32, 32, 0.05 } };
static cn_view views[VIEWS + 1]; /* the last one is not learned from */
static uint32_t order[VIEWS];
static cn_scene scene = { .cameras = &camera, .n_cameras = 1, .views = views, .n_views = VIEWS + 1 };
static cn_colour *colour;
static bool empty;
static double hills_m;                    /* how far away the sky is, if it is hills */
static double hanging[3], hanging_radius; /* a dark ball before the view that is not learned from */

/* Round the ball, 12 m from its middle, at different heights. */
static void place_view(cn_view *v, double turn, double height)
{
    double z[3] = { -cos(turn), -sin(turn), -height }, centre[3];
    (void)cn_normalize3(z);
    for (int k = 0; k < 3; k++)
        centre[k] = -12 * z[k];
    view_along(v, centre, z, (const double[3]){ 0, 0, 1 });
}

/* Along the ray, to the ball about `middle`; 0: the ray misses it, or meets it nearer than views show. */
static double depth_of(const double eye[3], const double dir[3], const double middle[3], double radius)
{
    double from[3];
    for (int k = 0; k < 3; k++)
        from[k] = eye[k] - middle[k];
    const double b = cn_dot3(from, dir), d = b * b - cn_dot3(from, from) + radius * radius;
    return d > 0 && -b - sqrt(d) > NEAR ? -b - sqrt(d) : 0;
}

static cn_status draw(void *user, const cn_context *ctx, const cn_camera *c, const cn_view *view, cn_picture *p)
{
    double eye[3];
    (void)user;
    (void)ctx;
    cn_view_centre(view, eye);
    for (uint32_t i = 0; i < c->width * c->height && !empty; i++) {
        double in_camera[3], dir[3], at[3];
        CN_TRY(cn_camera_unproject(c, i % c->width + 0.5, i / c->width + 0.5, in_camera));
        cn_mat3_tvec(view->rotation, in_camera, dir);
        const double dark = depth_of(eye, dir, hanging, hanging_radius);
        const double depth = dark > 0 ? dark : depth_of(eye, dir, (const double[3]){ 0 }, RADIUS);
        for (int k = 0; k < 3; k++)
            at[k] = eye[k] + depth * dir[k];
        const double shade[3][3] = { { 0.3, 0.45, 0.7 + 0.2 * dir[2] }, /* the sky */
                                     { 0.5 + 0.3 * sin(at[0]), 0.4 + 0.3 * sin(1.3 * at[1]), 0.5 + 0.1 * at[2] },
                                     { 0.02, 0.02, 0.02 } };
        for (int k = 0; k < 3; k++) /* grey colours are the same in ACEScg and sRGB, and others nearly so */
            p->rgba[4 * i + (unsigned)k] = (float)cn_srgb_decode(fmin(fmax(shade[dark > 0 ? 2 : depth > 0][k], 0), 1));
        p->depth[i] = (float)(depth > 0 ? depth : hills_m);
        p->rgba[4 * i + 3] = 1;
    }
    return CN_OK;
}

static int begin(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < VIEWS; i++) {
        order[i] = i;
        place_view(&views[i], i * 0.449, 0.4 * (i % 3) - 0.3);
    }
    place_view(&views[VIEWS], 1.05, 0.2);
    return cn_colour_create(&colour, "") == CN_OK ? 0 : -1;
}

static int end(void **state)
{
    (void)state;
    cn_colour_destroy(&colour);
    return 0;
}

static cn_splat_options options(void)
{
    return (cn_splat_options){ .budget = BUDGET, .degree = 1, .rounds = 5 };
}

static double near_m;

static cn_status make(const cn_context *ctx, const cn_splat_options *o, cn_splats **splats, cn_splat_report *report)
{
    const cn_splat_source source = { .scene = &scene,
                                     .views = order,
                                     .n_views = VIEWS,
                                     .width_px = SIDE,
                                     .near_m = near_m,
                                     .draw = draw,
                                     .colour = colour };
    return cn_splats_make(ctx, &source, o, "/tmp/conurb_splats.ply", splats, report);
}

/* PSNR in the view that was not learned from. */
static double score(const cn_splats *splats)
{
    const cn_context ctx = { 0 };
    const cn_camera pinhole = cn_splats_camera(&camera);
    static float truth[SIDE * SIDE * 4], test[SIDE * SIDE * 3];
    cn_picture picture;
    assert_int_equal(cn_picture_init(&picture, SIDE, SIDE), CN_OK);
    assert_int_equal(draw(NULL, NULL, &pinhole, &views[VIEWS], &picture), CN_OK);
    assert_int_equal(cn_colour_to_display(colour, NULL, picture.rgba, (size_t)SIDE * SIDE, 4), CN_OK);
    for (size_t i = 0; i < (size_t)SIDE * SIDE * 3; i++)
        truth[i] = picture.rgba[i / 3 * 4 + i % 3];
    assert_int_equal(cn_splats_render(&ctx, splats, &pinhole, &views[VIEWS], test), CN_OK);
    cn_picture_deinit(&picture);
    return cn_measure_psnr(truth, test, NULL, (size_t)SIDE * SIDE);
}

static void test_ball(void **state)
{
    (void)state;
    const cn_splat_options o = options();
    const cn_context ctx = { 0 };
    cn_splat_report report;
    cn_splats *splats;
    assert_int_equal(make(&ctx, &o, &splats, &report), CN_OK);
    assert_true(splats->n > BUDGET / 2 && splats->n <= BUDGET);
    assert_true(report.n_views > VIEWS && report.n_steps == o.rounds * report.n_views);
    size_t on_ball = 0, far = 0;
    for (size_t i = 0; i < splats->n; i++) {
        double sum = 0;
        for (int k = 0; k < 3; k++) {
            const double at = splats->origin[k] + (double)splats->centre[i][k];
            sum += at * at;
        }
        on_ball += fabs(sqrt(sum) - RADIUS) < 0.3;
        far += sqrt(sum) > 20;
    }
    assert_true(on_ball > splats->n / 3 && far > 50); /* the rest is at the ball's edge and before the sky */
    const double psnr = score(splats);
    if (!(psnr > 27 && report.psnr > 26)) fail_msg("PSNR %.2f dB, training %.2f dB", psnr, report.psnr);
    cn_splats_destroy(&splats);
}

/* Matter that hangs before a photo, nearer than its rays begin: other views show it, but it does not stand in the way.
 */
static void test_hanging(void **state)
{
    (void)state;
    const cn_splat_options o = options();
    const cn_context ctx = { 0 };
    cn_splats *splats;
    double psnr[2];
    cn_view_centre(&views[VIEWS], hanging);
    for (int k = 0; k < 3; k++)
        hanging[k] += 1.2 * views[VIEWS].rotation[6 + k];
    hanging_radius = 0.4;
    for (int i = 0; i < 2; i++) {
        near_m = i * NEAR;
        assert_int_equal(make(&ctx, &o, &splats, NULL), CN_OK);
        psnr[i] = score(splats);
        for (size_t s = 0; s < splats->n && i; s++) {
            double at[3];
            for (int k = 0; k < 3; k++)
                at[k] = splats->origin[k] + (double)splats->centre[s][k];
            assert_true(cn_distance3(at, hanging) > 0.5);
        }
        cn_splats_destroy(&splats);
    }
    print_message("matter before a camera kept, taken away: %.2f, %.2f dB\n", psnr[0], psnr[1]);
    assert_true(psnr[1] > psnr[0] + 5);
    hanging_radius = near_m = 0;
}

/* What stands near is shown, however far the view goes behind it. */
static void test_far_hills(void **state)
{
    (void)state;
    const cn_splat_options o = options();
    const cn_context ctx = { 0 };
    cn_splat_report report;
    cn_splats *splats;
    near_m = NEAR;
    hills_m = 8000;
    assert_int_equal(make(&ctx, &o, &splats, &report), CN_OK);
    const double psnr = score(splats);
    print_message("before hills: PSNR %.2f dB, training %.2f dB\n", psnr, report.psnr);
    assert_true(psnr > 24 && report.psnr > 24);
    cn_splats_destroy(&splats);
    near_m = hills_m = 0;
}

/* A photo of all directions shows the ball wherever it stands: here behind and beside the photos' middle. */
static void test_panoramas(void **state)
{
    (void)state;
    const cn_splat_options o = options();
    const cn_context ctx = { 0 };
    const cn_camera pinhole = camera;
    cn_view kept[VIEWS];
    cn_splat_report report;
    cn_splats *splats;
    memcpy(kept, views, sizeof kept);
    camera = (cn_camera){ .lens = CN_LENS_EQUIRECTANGULAR, .width = 128, .height = 64, .params = { 128, 64 } };
    for (uint32_t i = 0; i < VIEWS; i++) { /* turned about the vertical by a quarter, or by half */
        const double turn[2][9] = { { 0, 0, 1, 0, 1, 0, -1, 0, 0 }, { -1, 0, 0, 0, 1, 0, 0, 0, -1 } };
        cn_mat3_mul(turn[i % 2], kept[i].rotation, views[i].rotation);
        cn_mat3_vec(turn[i % 2], kept[i].translation, views[i].translation);
    }
    assert_int_equal(make(&ctx, &o, &splats, &report), CN_OK);
    camera = pinhole;
    memcpy(views, kept, sizeof kept);
    const double psnr = score(splats);
    print_message("by panoramas: PSNR %.2f dB, training %.2f dB\n", psnr, report.psnr);
    assert_true(psnr > 22 && report.n_views >= 6 * VIEWS);
    cn_splats_destroy(&splats);
}

static void test_threads(void **state)
{
    (void)state;
    cn_splat_options o = options();
    o.rounds = 2;
    cn_splats *one, *more;
    cn_context ctx = { 0 };
    cn_pool *pool;
    assert_int_equal(make(&ctx, &o, &one, NULL), CN_OK);
    assert_int_equal(cn_pool_create(&pool, 3), CN_OK);
    ctx.pool = pool;
    assert_int_equal(make(&ctx, &o, &more, NULL), CN_OK);
    assert_int_equal(one->n, more->n);
    assert_memory_equal(one->centre, more->centre, one->n * sizeof *one->centre);
    assert_memory_equal(one->scale, more->scale, one->n * sizeof *one->scale);
    assert_memory_equal(one->rotation, more->rotation, one->n * sizeof *one->rotation);
    assert_memory_equal(one->opacity, more->opacity, one->n * sizeof *one->opacity);
    assert_memory_equal(one->colour, more->colour, one->n * 12 * sizeof *one->colour);
    cn_splats_destroy(&one);
    cn_splats_destroy(&more);
    cn_pool_destroy(&pool);
}

static int stop;
static void stop_at_fit(void *user, const cn_progress_report *report)
{
    (void)user;
    if (strcmp(report->item, "splats: fit") == 0) cn_stop(&stop);
}

static void test_stopping(void **state)
{
    (void)state;
    cn_splat_options o = options();
    cn_context ctx = { .stop = &stop, .progress = stop_at_fit };
    cn_splats *splats;
    assert_int_equal(make(&ctx, &o, &splats, NULL), CN_ERR_INTERRUPTED);
    assert_null(splats);
    assert_int_equal(make(&ctx, &o, &splats, NULL), CN_ERR_INTERRUPTED); /* before the first view */
    ctx = (cn_context){ 0 };
    o.limit_s = 1e-6; /* the seeds alone */
    assert_int_equal(make(&ctx, &o, &splats, NULL), CN_OK);
    assert_true(splats->n > 0);
    cn_splats_destroy(&splats);
}

static void test_refused(void **state)
{
    (void)state;
    const cn_context ctx = { 0 };
    cn_splats *splats;
    cn_splat_options o = options();
    o.budget = 10;
    assert_int_equal(make(&ctx, &o, &splats, NULL), CN_ERR_USAGE);
    o = options();
    o.degree = 3;
    assert_int_equal(make(&ctx, &o, &splats, NULL), CN_ERR_USAGE);
    o = options();
    o.limit_s = NAN;
    assert_int_equal(make(&ctx, &o, &splats, NULL), CN_ERR_USAGE);
    o = options();
    empty = true;
    assert_int_equal(make(&ctx, &o, &splats, NULL), CN_ERR_DATA);
    empty = false;
    assert_null(splats);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_ball),      cmocka_unit_test(test_hanging),
                                        cmocka_unit_test(test_far_hills), cmocka_unit_test(test_panoramas),
                                        cmocka_unit_test(test_threads),   cmocka_unit_test(test_stopping),
                                        cmocka_unit_test(test_refused) };
    return cmocka_run_group_tests(tests, begin, end);
}
