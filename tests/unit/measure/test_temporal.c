/* Steadiness, on pictures of a painted floor seen from above by a camera that moves on: what is steady has the ratio 1,
 * what jumps has not; and seams, on the same floor by two tiles. */
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
    cn_camera camera;
    cn_view view;
    cn_temporal_frame frame;
} shot;

static float paint(double x, double y, int c)
{
    return (float)(0.5 + 0.2 * sin(1.3 * x + c) * cos(0.9 * y) + 0.1 * sin(3.1 * y));
}

/* What differs from frame to frame without a reason: -1 to 1, evenly. */
static float noise(uint32_t seed, uint32_t i)
{
    uint32_t h = (seed * 0x9e3779b9u) ^ (i * 0x85ebca6bu);
    h = (h ^ (h >> 16)) * 0x7feb352du;
    h = (h ^ (h >> 15)) * 0x846ca68bu;
    return (float)(h >> 8) / 8388608.0f - 1;
}

/* From (x, 0, HIGH), straight down. Two tiles share the strip |x| < 2; pop is added to the colour there. Pixels are off
 * by up to `rough`. */
static shot *take_rough(double x, float pop, float rough)
{
    static const double down[9] = { 1, 0, 0, 0, -1, 0, 0, 0, -1 };
    shot *s = calloc(1, sizeof *s);
    assert_non_null(s);
    s->camera = (cn_camera){
        .lens = CN_LENS_SIMPLE_PINHOLE, .width = WIDTH, .height = HEIGHT, .params = { 80, WIDTH / 2.0, HEIGHT / 2.0 }
    };
    memcpy(s->view.rotation, down, sizeof down);
    s->view.translation[0] = -x;
    s->view.translation[2] = HIGH;
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        double dir[3];
        assert_int_equal(cn_camera_unproject(&s->camera, i % WIDTH + 0.5, i / WIDTH + 0.5, dir), CN_OK);
        const double t = HIGH / dir[2], px = x + t * dir[0], py = -t * dir[1];
        s->depth[i] = (float)t;
        s->border[i] = fabs(px) < 2 ? 0.5f : 0;
        const float off = rough * noise((uint32_t)(100 + 10 * x), (uint32_t)i);
        for (int c = 0; c < 3; c++)
            s->rgb[3 * i + c] = paint(px, py, c) + (fabs(px) < 2 ? pop : 0) + off;
    }
    s->frame = (cn_temporal_frame){ WIDTH, HEIGHT, s->rgb, s->depth, s->border, &s->camera, &s->view };
    return s;
}

static shot *take(double x, float pop)
{
    return take_rough(x, pop, 0);
}

static cn_temporal_figures compare_rough(double x, float pop, float rough, bool switched)
{
    cn_temporal *sums = calloc(1, sizeof *sums);
    shot *before = take_rough(-0.4, 0, rough), *after = take_rough(x, pop, rough);
    assert_non_null(sums);
    cn_measure_temporal(sums, &before->frame, &after->frame, switched);
    const cn_temporal_figures f = cn_measure_temporal_figures(sums);
    free(sums);
    free(before);
    free(after);
    return f;
}

static cn_temporal_figures compare(double x, float pop, bool switched)
{
    return compare_rough(x, pop, 0, switched);
}

static void what_stays_is_steady(void **state)
{
    (void)state;
    const cn_temporal_figures f = compare(0.23, 0, false);
    assert_true(f.pixels.n_border > 500 && f.pixels.n_away > 2000);
    assert_true(f.pixels.border_mean < 0.01 && f.pixels.away_mean < 0.01);
    assert_true(f.pixels.away_median > 0 && f.pixels.away_median <= 2 * f.pixels.away_mean);
    assert_true(f.pixels.ratio > 0.9 && f.pixels.ratio < 1.1);
}

static void a_pop_at_a_border_shows(void **state)
{
    (void)state;
    const cn_temporal_figures f = compare(0.23, 0.03f, false);
    assert_true(fabs(f.pixels.border_mean - 0.03) < 0.003);
    assert_true(fabs(f.pixels.border_median - 0.03) < 0.003);
    assert_true(f.pixels.away_mean < 0.01);
    assert_true(f.pixels.ratio > 3);
}

static void frames_of_different_tiles_are_all_border(void **state)
{
    (void)state;
    const cn_temporal_figures f = compare(0.23, 0, true);
    assert_true(f.pixels.n_border > 2500 && f.pixels.n_away == 0);
    assert_true(isnan(f.pixels.away_mean) && isnan(f.pixels.ratio));
}

/* A hundredth of light is lost in pixels that are off by more than that. */
static void light_that_drifts_shows_below_the_noise(void **state)
{
    (void)state;
    const cn_temporal_figures still = compare_rough(0.23, 0, 0.04f, false),
                              drifts = compare_rough(0.23, 0.01f, 0.04f, false);
    assert_true(still.light.n_border >= 18 && still.light.n_away >= 60);
    assert_true(still.pixels.ratio > 0.9 && still.pixels.ratio < 1.1);
    assert_true(still.light.ratio > 0.7 && still.light.ratio < 1.3);
    assert_true(drifts.pixels.ratio < 1.2);
    assert_true(drifts.light.ratio > 2);
    assert_true(fabs(drifts.light.border_mean - 0.01) < 0.002);
}

enum { LEFT_ENDS = 44, RIGHT_BEGINS = 52 }; /* between these columns two tiles share */

/* A floor that belongs to two tiles; what the right one shows is lighter by `step`, and either has noise of its own. */
static cn_seam_figures two_tiles(float step, bool shared_only)
{
    enum { N = HEIGHT * WIDTH };
    float *rgb = calloc(10 * (size_t)N, sizeof *rgb), *alone[2] = { rgb + 3 * N, rgb + 6 * N }, *border = rgb + 9 * N;
    uint32_t *owner = calloc(N, sizeof *owner);
    assert_non_null(rgb);
    assert_non_null(owner);
    for (int i = 0; i < N; i++) {
        const int x = i % WIDTH;
        const float right =
            shared_only ? 0.5f : fminf(fmaxf((float)(x - LEFT_ENDS) / (RIGHT_BEGINS - LEFT_ENDS), 0), 1);
        owner[i] = right >= 0.5f;
        border[i] = fminf(right, 1 - right);
        for (int c = 0; c < 3; c++) {
            const float scene = paint(0.25 * x, 0.25 * (i / WIDTH), c);
            alone[0][3 * i + c] = scene + 0.02f * noise(1, (uint32_t)i);
            alone[1][3 * i + c] = scene + 0.02f * noise(2, (uint32_t)i) + step;
            rgb[3 * i + c] = (1 - right) * alone[0][3 * i + c] + right * alone[1][3 * i + c];
        }
    }
    const cn_seam_frame frame = { WIDTH, HEIGHT, rgb, border, owner, (const float *const *)alone, 2 };
    cn_seam seam = { 0 };
    cn_measure_seam(&seam, &frame);
    free(rgb);
    free(owner);
    return cn_measure_seam_figures(&seam);
}

static void a_seam_shows_over_the_scene_s_own_step(void **state)
{
    (void)state;
    const cn_seam_figures none = two_tiles(0, false), some = two_tiles(0.1f, false), shared = two_tiles(0.1f, true);
    assert_int_equal(none.n, HEIGHT / CN_TEMPORAL_BLOCK); /* a crossing in each row of blocks */
    assert_true(none.step > 0.02);                        /* the floor's own paint */
    assert_true(none.ratio > 0.9 && none.ratio < 1.1);
    assert_true(fabs(some.own_step - none.own_step) < 1e-3);
    assert_true(some.ratio > 1.25);
    assert_int_equal(shared.n, 0);
    assert_true(isnan(shared.ratio) && isnan(shared.step));
}

/* What the frame before does not show is not compared: something stands in front of it there. */
static void hidden_places_do_not_count(void **state)
{
    (void)state;
    cn_temporal *sums = calloc(1, sizeof *sums);
    shot *before = take(-0.4, 0), *after = take(0.23, 0);
    assert_non_null(sums);
    for (int i = 0; i < WIDTH * HEIGHT; i++)
        before->depth[i] *= 0.8f;
    cn_measure_temporal(sums, &before->frame, &after->frame, false);
    assert_int_equal(sums->away.n + sums->border.n, 0);
    free(sums);
    free(before);
    free(after);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(what_stays_is_steady),
                                        cmocka_unit_test(a_pop_at_a_border_shows),
                                        cmocka_unit_test(frames_of_different_tiles_are_all_border),
                                        cmocka_unit_test(hidden_places_do_not_count),
                                        cmocka_unit_test(light_that_drifts_shows_below_the_noise),
                                        cmocka_unit_test(a_seam_shows_over_the_scene_s_own_step) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
