#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "conurb/compose.h"

#include <math.h>
#include <string.h>

enum { W = 37, H = 21 };

static void paint(cn_picture *p, uint32_t x, uint32_t y, const float rgb[3], float alpha)
{
    float *at = p->rgba + 4 * ((size_t)y * p->width + x);
    for (int c = 0; c < 3; c++)
        at[c] = alpha * rgb[c];
    at[3] = alpha;
}

static void setup(cn_picture *p, uint32_t width, uint32_t height)
{
    static const float red[3] = { 0.8f, 0.1f, 0.1f }, blue[3] = { 0.1f, 0.1f, 0.9f };
    assert_int_equal(cn_picture_init(p, width, height), CN_OK);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++)
            paint(p, x, y, x < width / 2 ? red : blue, 1);
}

static void holes_take_the_colours_around_them(void **state)
{
    (void)state;
    static const float none[3] = { 0 };
    cn_picture p;
    setup(&p, W, H);
    paint(&p, 5, 5, none, 0);
    for (uint32_t x = 28; x < 32; x++)
        for (uint32_t y = 10; y < 14; y++)
            paint(&p, x, y, none, 0);
    assert_int_equal(cn_compose_unseen(&p, CN_UNSEEN_FILL), CN_OK);
    for (size_t i = 0; i < (size_t)W * H; i++) {
        const float *want = i % W < W / 2 ? (const float[]){ 0.8f, 0.1f, 0.1f } : (const float[]){ 0.1f, 0.1f, 0.9f };
        for (int c = 0; c < 3; c++)
            assert_true(fabsf(p.rgba[4 * i + (size_t)c] - want[c]) < 0.02f);
        assert_true(p.rgba[4 * i + 3] == 1);
    }
    cn_picture_deinit(&p);
}

/* A pixel that is half there keeps its own colour for that half. */
static void half_a_pixel_counts_half(void **state)
{
    (void)state;
    static const float green[3] = { 0, 1, 0 };
    cn_picture p;
    setup(&p, W, H);
    paint(&p, 4, 9, green, 0.5f);
    assert_int_equal(cn_compose_unseen(&p, CN_UNSEEN_FILL), CN_OK);
    const float *at = p.rgba + 4 * (9 * W + 4);
    assert_true(fabsf(at[1] - 0.55f) < 0.1f && fabsf(at[0] - 0.4f) < 0.1f && at[3] == 1);
    cn_picture_deinit(&p);
}

/* A large hole holds a trace of fog, whose colour is as bright as it is thin. It must not shine out of the hole. */
static void a_trace_of_fog_fills_nothing(void **state)
{
    (void)state;
    static const float red[3] = { 0.8f, 0.1f, 0.1f }, glare[3] = { 9, 9, 9 };
    cn_picture p;
    assert_int_equal(cn_picture_init(&p, 300, 200), CN_OK);
    for (uint32_t y = 0; y < 200; y++)
        for (uint32_t x = 0; x < 300; x++) {
            const bool hole = x > 60 && x < 240 && y > 40 && y < 160;
            paint(&p, x, y, hole ? glare : red, hole ? 1e-3f : 1);
        }
    assert_int_equal(cn_compose_unseen(&p, CN_UNSEEN_FILL), CN_OK);
    for (size_t i = 0; i < 300 * 200; i++)
        assert_true(fabsf(p.rgba[4 * i] - 0.8f) < 0.05f && p.rgba[4 * i + 1] < 0.15f);
    cn_picture_deinit(&p);
}

static void large_holes_are_grey_where_asked(void **state)
{
    (void)state;
    cn_picture p;
    assert_int_equal(cn_picture_init(&p, 300, 200), CN_OK);
    static const float red[3] = { 0.8f, 0.1f, 0.1f };
    for (uint32_t y = 0; y < 200; y++)
        for (uint32_t x = 0; x < 100; x++)
            paint(&p, x, y, red, x != 50); /* a narrow hole beside a wide one */
    assert_int_equal(cn_compose_unseen(&p, CN_UNSEEN_NEUTRAL), CN_OK);
    const float *narrow = p.rgba + 4 * (100 * 300 + 50), *wide = p.rgba + 4 * (100 * 300 + 250);
    assert_true(fabsf(narrow[0] - 0.8f) < 0.05f && narrow[3] == 1);
    assert_true(fabsf(wide[0] - 0.18f) < 1e-3f && fabsf(wide[2] - 0.18f) < 1e-3f && wide[3] == 1);
    cn_picture_deinit(&p);
}

/* Sky above, ground below. A hole in the ground shows a tinge of sky, as renders do just below the horizon: it takes
 * the colour of the ground. What is open below the horizon and touches the sky stays. */
static void tinged_holes_are_filled_whole(void **state)
{
    (void)state;
    static const float sky[3] = { 0.1f, 0.1f, 0.9f }, ground[3] = { 0.8f, 0.1f, 0.1f };
    cn_picture p;
    setup(&p, W, H);
    for (uint32_t y = 0; y < H; y++)
        for (uint32_t x = 0; x < W; x++) {
            paint(&p, x, y, y < 8 ? sky : ground, 1);
            p.depth[y * W + x] = y < 8 ? 0 : 20;
        }
    for (uint32_t x = 10; x < 14; x++)
        paint(&p, x, 14, sky, 0.6f), p.depth[14 * W + x] = 0;
    paint(&p, 14, 14, sky, 0.9f); /* the hole's edge: some ground, some sky */
    paint(&p, 30, 8, sky, 0.8f), p.depth[8 * W + 30] = 0;
    assert_int_equal(cn_compose_unseen(&p, CN_UNSEEN_FILL), CN_OK);
    for (uint32_t x = 9; x < 16; x++)
        for (int c = 0; c < 3; c++)
            assert_true(fabsf(p.rgba[4 * (14 * W + x) + (uint32_t)c] - ground[c]) < 0.02f);
    assert_true(p.rgba[4 * (8 * W + 30) + 2] > 0.7f);
    cn_picture_deinit(&p);
}

/* A hole between a wall and the sky above the horizon: no photo saw what is there, but photos show houses that way. */
static void the_sky_does_not_fill_holes(void **state)
{
    (void)state;
    static const float sky[3] = { 0.1f, 0.1f, 0.9f }, wall[3] = { 0.8f, 0.1f, 0.1f }, none[3] = { 0 };
    cn_picture p;
    setup(&p, W, H);
    for (uint32_t y = 0; y < H; y++)
        for (uint32_t x = 0; x < W; x++) {
            const bool hole = x >= 6 && x < 18 && y >= 6;
            paint(&p, x, y, hole ? none : x < 6 ? wall : sky, !hole);
            p.depth[y * W + x] = x < 6 ? 20 : 0;
        }
    assert_int_equal(cn_compose_unseen(&p, CN_UNSEEN_FILL), CN_OK);
    for (uint32_t y = 0; y < H; y++)
        for (uint32_t x = 0; x < W; x++) {
            const float *want = x < 18 && (x < 6 || y >= 6) ? wall : sky, *at = p.rgba + 4 * (y * W + x);
            assert_true(fabsf(at[0] - want[0]) < 0.02f && fabsf(at[2] - want[2]) < 0.02f && at[3] == 1);
        }
    cn_picture_deinit(&p);
}

/* Sky shows through a wall in four places: a fleck in the wall is filled; a gap between the wall and another one behind
 * it, a window-sized opening, and what touches the picture's edge stay. */
static void flecks_in_a_wall_are_filled(void **state)
{
    (void)state;
    enum { WIDE = 400, HIGH = 120 };
    static const float sky[3] = { 0.1f, 0.1f, 0.9f }, wall[3] = { 0.8f, 0.1f, 0.1f };
    cn_picture p;
    assert_int_equal(cn_picture_init(&p, WIDE, HIGH), CN_OK);
    for (uint32_t y = 0; y < HIGH; y++)
        for (uint32_t x = 0; x < WIDE; x++) {
            const bool fleck = x >= 50 && x < 53 && y >= 60 && y < 64, gap = x == 200 && y >= 40 && y < 44,
                       window = x >= 300 && x < 320 && y >= 40 && y < 50, edge = x == 90 && y < 3;
            const bool open = fleck || gap || window || edge;
            paint(&p, x, y, open ? sky : wall, 1);
            p.depth[y * WIDE + x] = open ? 0 : (x < 200 ? 20 : 40) + 0.01f * (float)x;
        }
    assert_int_equal(cn_compose_unseen(&p, CN_UNSEEN_FILL), CN_OK);
    const float *fleck = p.rgba + 4 * (62 * WIDE + 51), *gap = p.rgba + 4 * (42 * WIDE + 200),
                *window = p.rgba + 4 * (45 * WIDE + 310), *edge = p.rgba + 4 * (1 * WIDE + 90);
    assert_true(fabsf(fleck[0] - 0.8f) < 0.02f && fabsf(fleck[2] - 0.1f) < 0.02f && fleck[3] == 1);
    assert_true(gap[2] == 0.9f && window[2] == 0.9f && edge[2] == 0.9f);
    cn_picture_deinit(&p);
}

/* At the end of the reach a picture fades as a whole, sky and matter alike: it is filled as if it did not fade. With
 * grey for large holes, too. */
static void what_fades_is_not_unseen(void **state)
{
    (void)state;
    static const float sky[3] = { 0.1f, 0.1f, 0.9f }, wall[3] = { 0.8f, 0.1f, 0.1f }, none[3] = { 0 };
    static const double coverages[] = { 0.99, 0.8, 0.3, 0.01, 0 };
    for (cn_unseen unseen = CN_UNSEEN_FILL; unseen <= CN_UNSEEN_NEUTRAL; unseen++)
        for (size_t k = 0; k < sizeof coverages / sizeof *coverages; k++) {
            cn_picture whole, faded;
            setup(&whole, W, H);
            setup(&faded, W, H);
            for (uint32_t y = 0; y < H; y++)
                for (uint32_t x = 0; x < W; x++) {
                    const bool hole = x == 20 && y > 14;
                    paint(&whole, x, y, hole ? none : y < 10 ? sky : wall, !hole);
                    faded.depth[y * W + x] = whole.depth[y * W + x] = y < 10 || hole ? 0 : 20;
                }
            memcpy(faded.rgba, whole.rgba, (size_t)W * H * 4 * sizeof *faded.rgba);
            cn_compose_fade(&faded, coverages[k]);
            assert_int_equal(cn_compose_unseen(&whole, unseen), CN_OK);
            assert_int_equal(cn_compose_unseen(&faded, unseen), CN_OK);
            for (size_t i = 0; i < (size_t)W * H * 4; i++)
                assert_true(fabs((double)faded.rgba[i] - coverages[k] * (double)whole.rgba[i]) < 1e-5);
            assert_true(whole.rgba[2] == 0.9f && fabsf(whole.rgba[4 * (16 * W + 20)] - 0.8f) < 0.05f);
            cn_picture_deinit(&whole);
            cn_picture_deinit(&faded);
        }
}

/* A picture of all directions: what is filled behind the camera goes on over the left and right edge. A fleck in a wall
 * there is filled, too. */
static void all_directions_have_no_edge_behind(void **state)
{
    (void)state;
    static const uint32_t widths[] = { 256, 250, 201, 131 };
    static const float sky[3] = { 0.1f, 0.1f, 0.9f }, none[3] = { 0 };
    for (size_t k = 0; k < sizeof widths / sizeof *widths; k++) {
        const uint32_t w = widths[k], h = w / 2, edge = w / 9;
        cn_picture p;
        assert_int_equal(cn_picture_init(&p, w, h), CN_OK);
        p.wraps = true;
        for (uint32_t y = 0; y < h; y++)
            for (uint32_t x = 0; x < w; x++) {
                const float s = 0.5f + 0.4f * sinf(((float)x + 0.5f) / (float)w * 6.2831853f);
                const bool hole = (x < edge || x >= w - edge) && y > h / 4;
                paint(&p, x, y, hole ? none : (const float[]){ s, s, s }, !hole);
                p.depth[y * w + x] = hole ? 0 : 10;
            }
        paint(&p, 0, 4, sky, 1); /* a fleck above the hole */
        p.depth[4 * w] = 0;
        assert_int_equal(cn_compose_unseen(&p, CN_UNSEEN_FILL), CN_OK);
        float seam = 0, steepest = 0;
        for (uint32_t y = h / 4 + 1; y < h; y++)
            for (uint32_t x = 0; x < w; x++) {
                const float step = fabsf(p.rgba[4 * (y * w + x)] - p.rgba[4 * (y * w + (x + 1) % w)]);
                if (x == w - 1) seam = fmaxf(seam, step);
                if (x < w - 1) steepest = fmaxf(steepest, step);
            }
        assert_true(seam < 1.1f * steepest && seam < 0.05f);
        assert_true(fabsf(p.rgba[4 * (4 * w)] - p.rgba[4 * (4 * w) + 2]) < 0.02f);
        cn_picture_deinit(&p);
    }
}

static void black_changes_nothing(void **state)
{
    (void)state;
    static const float none[3] = { 0 };
    cn_picture p;
    setup(&p, W, H);
    paint(&p, 5, 5, none, 0);
    assert_int_equal(cn_compose_unseen(&p, CN_UNSEEN_BLACK), CN_OK);
    assert_true(p.rgba[4 * (5 * W + 5)] == 0 && p.rgba[4 * (5 * W + 5) + 3] == 0);
    cn_picture_deinit(&p);
}

/* Nothing to fill from, a picture of one pixel, and numbers that are not finite: no crash, and no colour from nowhere.
 */
static void hard_pictures(void **state)
{
    (void)state;
    static const uint32_t sizes[][2] = { { 1, 1 }, { 1, 9 }, { 9, 1 }, { 2, 2 }, { 64, 3 } };
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        cn_picture p;
        assert_int_equal(cn_picture_init(&p, sizes[s][0], sizes[s][1]), CN_OK);
        assert_int_equal(cn_compose_unseen(&p, CN_UNSEEN_FILL), CN_OK);
        for (size_t i = 0; i < 4 * (size_t)p.width * p.height; i++)
            assert_true(p.rgba[i] == 0);
        cn_picture_deinit(&p);
    }
    static const float none[3] = { 0 };
    cn_picture p;
    setup(&p, W, H);
    paint(&p, 3, 3, (const float[]){ NAN, INFINITY, 0 }, 1);
    paint(&p, 4, 3, none, 0);
    assert_int_equal(cn_compose_unseen(&p, CN_UNSEEN_FILL), CN_OK);
    assert_true(fabsf(p.rgba[4 * (3 * W + 4)] - 0.8f) < 0.02f);
    cn_picture_deinit(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(holes_take_the_colours_around_them),
        cmocka_unit_test(half_a_pixel_counts_half),
        cmocka_unit_test(large_holes_are_grey_where_asked),
        cmocka_unit_test(tinged_holes_are_filled_whole),
        cmocka_unit_test(the_sky_does_not_fill_holes),
        cmocka_unit_test(flecks_in_a_wall_are_filled),
        cmocka_unit_test(what_fades_is_not_unseen),
        cmocka_unit_test(all_directions_have_no_edge_behind),
        cmocka_unit_test(black_changes_nothing),
        cmocka_unit_test(hard_pictures),
        cmocka_unit_test(a_trace_of_fog_fills_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
