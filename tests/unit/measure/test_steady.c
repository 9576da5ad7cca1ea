/* Steadiness, on pictures of a painted floor seen from above by a camera that moves on: what is steady has the ratio 1, what jumps has not. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "conurb/measure.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 96, HEIGHT = 72 };
#define HIGH 20.0 /* of the camera, metres */

typedef struct shot {
    float rgb[HEIGHT * WIDTH * 3], depth[HEIGHT * WIDTH], border[HEIGHT * WIDTH];
    cn_camera camera; cn_view view; cn_steady_frame frame;
} shot;

static float paint(double x, double y, int c) { return (float)(0.5 + 0.2 * sin(1.3 * x + c) * cos(0.9 * y) + 0.1 * sin(3.1 * y)); }

/* From (x, 0, HIGH), straight down. Two tiles share the strip |x| < 2; pop is added to the colour there. */
static shot *take(double x, float pop)
{
    static const double down[9] = {1, 0, 0, 0, -1, 0, 0, 0, -1};
    shot *s = calloc(1, sizeof *s);
    assert_non_null(s);
    s->camera = (cn_camera){.lens = CN_LENS_SIMPLE_PINHOLE, .width = WIDTH, .height = HEIGHT, .params = {80, WIDTH / 2.0, HEIGHT / 2.0}};
    memcpy(s->view.rotation, down, sizeof down);
    s->view.translation[0] = -x;
    s->view.translation[2] = HIGH;
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        double dir[3];
        assert_int_equal(cn_camera_unproject(&s->camera, i % WIDTH + 0.5, i / WIDTH + 0.5, dir), CN_OK);
        const double t = HIGH / dir[2], px = x + t * dir[0], py = -t * dir[1];
        s->depth[i] = (float)t;
        s->border[i] = fabs(px) < 2 ? 0.5f : 0;
        for (int c = 0; c < 3; c++) s->rgb[3 * i + c] = paint(px, py, c) + (fabs(px) < 2 ? pop : 0);
    }
    s->frame = (cn_steady_frame){WIDTH, HEIGHT, s->rgb, s->depth, s->border, &s->camera, &s->view};
    return s;
}

static cn_steady_figures compare(double x, float pop, bool switched)
{
    cn_steady *steady = calloc(1, sizeof *steady);
    shot *before = take(-0.4, 0), *after = take(x, pop);
    assert_non_null(steady);
    cn_measure_steady(steady, &before->frame, &after->frame, switched);
    const cn_steady_figures f = cn_measure_steady_figures(steady);
    free(steady);
    free(before);
    free(after);
    return f;
}

static void what_stays_is_steady(void **state)
{
    (void)state;
    const cn_steady_figures f = compare(0.23, 0, false);
    assert_true(f.n_border > 500 && f.n_away > 2000);
    assert_true(f.border_mean < 0.01 && f.away_mean < 0.01);
    assert_true(f.away_median > 0 && f.away_median <= 2 * f.away_mean);
    assert_true(f.ratio > 0.9 && f.ratio < 1.1);
}

static void a_pop_at_a_border_shows(void **state)
{
    (void)state;
    const cn_steady_figures f = compare(0.23, 0.03f, false);
    assert_true(fabs(f.border_mean - 0.03) < 0.003);
    assert_true(fabs(f.border_median - 0.03) < 0.003);
    assert_true(f.away_mean < 0.01);
    assert_true(f.ratio > 3);
}

static void frames_of_different_tiles_are_all_border(void **state)
{
    (void)state;
    const cn_steady_figures f = compare(0.23, 0, true);
    assert_true(f.n_border > 2500 && f.n_away == 0);
    assert_true(isnan(f.away_mean) && isnan(f.ratio));
}

/* What the frame before does not show is not compared: something stands in front of it there. */
static void hidden_places_do_not_count(void **state)
{
    (void)state;
    cn_steady *steady = calloc(1, sizeof *steady);
    shot *before = take(-0.4, 0), *after = take(0.23, 0);
    assert_non_null(steady);
    for (int i = 0; i < WIDTH * HEIGHT; i++) before->depth[i] *= 0.8f;
    cn_measure_steady(steady, &before->frame, &after->frame, false);
    assert_int_equal(steady->away.n + steady->border.n, 0);
    free(steady);
    free(before);
    free(after);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_stays_is_steady), cmocka_unit_test(a_pop_at_a_border_shows),
        cmocka_unit_test(frames_of_different_tiles_are_all_border), cmocka_unit_test(hidden_places_do_not_count)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
