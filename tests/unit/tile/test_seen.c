/* A ray that meets no matter: whether there is none, or no photo saw it. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "tile/seen.h"

#include <math.h>
#include <string.h>

static uint32_t places[CN_SEEN_PLACES / 32];
static uint8_t matter[CN_SEEN_DIRECTIONS];
static float distance[CN_SEEN_DIRECTIONS];
static const cn_seen seen = { places, matter, distance, NULL };

/* Photos show matter in the west below 30 degrees, 8 m away, and none in the east. They have seen the places in the
 * north. */
static int fill(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < CN_SEEN_DIRECTIONS; i++) {
        float dir[3];
        cn_seen_direction(i, dir);
        assert_float_equal(dir[0] * dir[0] + dir[1] * dir[1] + dir[2] * dir[2], 1, 1e-5);
        assert_true(dir[2] > CN_SEEN_LOWEST && dir[2] < 1);
        matter[i] = dir[0] < 0 && dir[2] < 0.5f ? 255 : 0;
        distance[i] = dir[0] < 0 ? 8 : 0;
    }
    for (uint32_t i = 0; i < CN_SEEN_PLACES; i++)
        if (i / CN_SEEN_RES % CN_SEEN_RES >= CN_SEEN_RES / 2) places[i / 32] |= (uint32_t)1 << (i % 32);
    return 0;
}

/* A box of 10 m. place: in box units. */
static float open(float x, float y, float east, float north, float up)
{
    const float length = sqrtf(east * east + north * north + up * up);
    const float dir[3] = { east / length, north / length, up / length };
    const cn_box_ray ray = { { x, y, 0 }, { dir[0] / 10, dir[1] / 10, dir[2] / 10 } };
    return cn_seen_open(&seen, &ray, dir);
}

static void only_unseen_matter_is_unsure(void **state)
{
    (void)state;
    assert_true(open(0, -0.5f, -1, 0, 0.1f) == 0);  /* to the west, through places that no photo saw */
    assert_true(open(0, 0.5f, -1, 0, 0.1f) == 1);   /* photos looked through these places */
    assert_true(open(0, -0.5f, 1, 0, 0.1f) == 1);   /* photos show sky in the east */
    assert_true(open(0, -0.5f, -1, 0, 2) == 1);     /* and high in the west */
    assert_true(open(0, -0.5f, -1, -1, 0.1f) == 0); /* to the south-west */
    /* What matters is where matter is expected: from 4 to 16 m. Here the ray leaves the unseen places after 2 m. */
    assert_true(open(0, -0.1f, -1, 0.5f, 0.1f) == 1);
    assert_true(open(0, -0.9f, -1, 0.5f, 0.1f) == 0); /* and here after 20 m */
}

/* Photos from 8 m show a front in the west, whose foot is 8 m from the box's centre. A ray that begins 8 m farther back
 * goes through places that no photo saw, before it reaches those before the front. */
static void a_front_is_farther_from_farther_back(void **state)
{
    (void)state;
    static float reach[CN_SEEN_DIRECTIONS];
    const cn_seen at_one_place = { places, matter, distance, reach };
    const float length = sqrtf(1.25f), dir[3] = { -1 / length, 0.5f / length, 0 };
    const cn_box_ray ray = { { 0.8f, -0.5f, 0 }, { dir[0] / 10, dir[1] / 10, 0 } };
    assert_true(cn_seen_open(&seen, &ray, dir) < 0.5f);
    for (uint32_t i = 0; i < CN_SEEN_DIRECTIONS; i++)
        reach[i] = 8;
    assert_true(cn_seen_open(&at_one_place, &ray, dir) == 1);
    for (uint32_t i = 0; i < CN_SEEN_DIRECTIONS; i++)
        reach[i] = -INFINITY;
    assert_true(cn_seen_open(&at_one_place, &ray, dir) == cn_seen_open(&seen, &ray, dir));
    /* From nearer than the photos, and from beyond the front, it stays as it is. */
    const cn_box_ray beyond = { { -0.9f, -0.9f, 0 }, { dir[0] / 10, dir[1] / 10, 0 } };
    for (uint32_t i = 0; i < CN_SEEN_DIRECTIONS; i++)
        reach[i] = 8;
    assert_true(cn_seen_open(&at_one_place, &beyond, dir) == cn_seen_open(&seen, &beyond, dir));
}

/* Photos saw the places up to 3 m, and no sky anywhere. Higher up nothing stands on them. */
static void walls_stand_on_the_ground(void **state)
{
    (void)state;
    static uint32_t low[CN_SEEN_PLACES / 32], none[CN_SEEN_PLACES / 32];
    static uint8_t all[CN_SEEN_DIRECTIONS];
    memset(all, 255, sizeof all);
    for (uint32_t i = 0; i < CN_SEEN_PLACES; i++)
        if (i / (CN_SEEN_RES * CN_SEEN_RES) < CN_SEEN_RES / 2 + 5) low[i / 32] |= (uint32_t)1 << (i % 32);
    const cn_seen above = { low, all, distance, NULL }, nothing = { none, all, distance, NULL };
    const float up = sqrtf(0.5f), dir[3] = { -up, 0, up };
    const cn_box_ray ray = { { 0 }, { dir[0] / 10, 0, dir[2] / 10 } };
    assert_true(cn_seen_open(&above, &ray, dir) == 1);
    assert_true(cn_seen_open(&nothing, &ray, dir) == 0);
}

/* From sure to unsure in small steps: a jump would be an edge in the picture. */
static void turns_gently(void **state)
{
    (void)state;
    float before = open(0, -0.5f, -1, 0, 0), least = 1, most = 0;
    for (int i = 1; i <= 1000; i++) {
        const float now = open(0, -0.5f, -1, 0, (float)i / 1000);
        assert_true(fabsf(now - before) < 0.1f);
        before = now;
        least = fminf(least, now);
        most = fmaxf(most, now);
    }
    assert_true(least == 0 && most == 1);
}

/* All around, the first and the last column meet. Straight up and below the lowest row there is an answer too. */
static void every_direction_has_an_answer(void **state)
{
    (void)state;
    for (int i = 0; i <= 720; i++) {
        const float turn = (float)i / 720 * 6.2831853f;
        for (float up = -2; up <= 2; up += 0.25f) {
            const float k = open(0.1f, -0.3f, cosf(turn), sinf(turn), up);
            assert_true(k >= 0 && k <= 1);
        }
    }
    assert_true(open(0, -0.5f, 0, 0, 1) == 1);
    assert_true(open(0, -0.5f, -1, -1e-7f, 0) == open(0, -0.5f, -1, 1e-7f, 0));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(only_unseen_matter_is_unsure),  cmocka_unit_test(a_front_is_farther_from_farther_back),
        cmocka_unit_test(walls_stand_on_the_ground),     cmocka_unit_test(turns_gently),
        cmocka_unit_test(every_direction_has_an_answer),
    };
    return cmocka_run_group_tests(tests, fill, NULL);
}
