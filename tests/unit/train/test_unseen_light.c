#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/rng.h"
#include "train/unseen_light.h"

#include <math.h>
#include <string.h>

enum { TRAINED = 40, HELD = 6, N = TRAINED + HELD };

/* Photos a metre apart along a walk, all looking the same way; held-out ones lie between two trained ones. */
static double along(uint32_t i)
{
    return i < TRAINED ? i : 5.5 + 6.0 * (i - TRAINED);
}

static void make_views(cn_view *views, const cn_view **list)
{
    memset(views, 0, N * sizeof *views);
    for (uint32_t i = 0; i < N; i++) {
        for (int a = 0; a < 3; a++)
            views[i].rotation[4 * a] = 1;
        views[i].translation[0] = -along(i);
        list[i] = &views[i];
    }
}

static double slow(double x)
{
    return 0.5 * sin(0.3 * x);
}

static void a_light_that_changes_slowly_is_followed(void **state)
{
    (void)state;
    cn_view views[N];
    const cn_view *list[N];
    float rows[N] = { 0 };
    make_views(views, list);
    for (uint32_t i = 0; i < TRAINED; i++)
        rows[i] = (float)slow(along(i));
    cn_unseen_light(list, NULL, N, TRAINED, 1, rows);
    for (uint32_t i = TRAINED; i < N; i++)
        assert_true(fabs((double)rows[i] - slow(along(i))) < 0.06);
}

/* To follow a neighbour there would be worse than the mean. */
static void a_light_of_its_own_in_each_photo_stays_at_the_mean(void **state)
{
    (void)state;
    cn_view views[N];
    const cn_view *list[N];
    float rows[N][4];
    make_views(views, list);
    memset(rows, 0, sizeof rows);
    for (uint32_t i = 0; i < TRAINED; i++)
        for (uint32_t c = 0; c < 4; c++)
            rows[i][c] = cn_rng_float(5, c, i) - 0.5f;
    cn_unseen_light(list, NULL, N, TRAINED, 4, rows[0]);
    for (uint32_t i = TRAINED; i < N; i++)
        for (uint32_t c = 0; c < 4; c++)
            assert_true(fabsf(rows[i][c]) < 0.15f);
}

/* Neighbours among a few photos agree by chance, up to half of the time. */
static void a_few_photos_agree_by_chance(void **state)
{
    (void)state;
    enum { TRIALS = 200, FEW = 8 };
    cn_view views[N];
    const cn_view *list[N];
    uint32_t followed = 0;
    make_views(views, list);
    for (uint32_t trial = 0; trial < TRIALS; trial++) {
        float rows[FEW + 1] = { 0 };
        for (uint32_t i = 0; i < FEW; i++)
            rows[i] = cn_rng_float(6, trial, i) - 0.5f;
        cn_unseen_light(list, NULL, FEW + 1, FEW, 1, rows);
        followed += fabsf(rows[FEW]) > 0;
    }
    assert_true(followed < TRIALS / 5); /* without a look at how clear it is: 95 of 200 */
}

/* Two runs along one walk, by day and by night, one photo of each in turn: a photo has the light of its run, though its
 * neighbours are of the other. One whose time is unknown has the mean light. */
static void a_photo_has_the_light_of_its_run(void **state)
{
    (void)state;
    cn_view views[N];
    const cn_view *list[N];
    float rows[N] = { 0 }, run[N];
    make_views(views, list);
    for (uint32_t i = 0; i < N; i++) {
        run[i] = (float)(1 + i % 2);
        if (i < TRAINED) rows[i] = (i % 2 ? 1 : -1) + 0.1f * (cn_rng_float(5, 0, i) - 0.5f);
    }
    run[N - 1] = 0;
    cn_unseen_light(list, run, N, TRAINED, 1, rows);
    for (uint32_t i = TRAINED; i < N - 1; i++)
        assert_true(fabsf(rows[i] - (i % 2 ? 1 : -1)) < 0.1f);
    assert_true(fabsf(rows[N - 1]) < 0.1f);
}

/* One run has the mean light. */
static void one_run_tells_nothing(void **state)
{
    (void)state;
    cn_view views[N];
    const cn_view *list[N];
    float with[N] = { 0 }, without[N] = { 0 }, run[N];
    make_views(views, list);
    for (uint32_t i = 0; i < N; i++) {
        run[i] = 1;
        if (i < TRAINED) with[i] = without[i] = (float)slow(along(i));
    }
    cn_unseen_light(list, run, N, TRAINED, 1, with);
    cn_unseen_light(list, NULL, N, TRAINED, 1, without);
    assert_memory_equal(with, without, sizeof with);
}

/* Too few photos, photos of one place, and none: nothing is said of the others. */
static void nothing_to_learn_from(void **state)
{
    (void)state;
    cn_view views[N];
    const cn_view *list[N];
    make_views(views, list);
    float few[N] = { 1, -1, 1, -1 };
    cn_unseen_light(list, NULL, 6, 4, 1, few);
    assert_true(few[4] == 0 && few[5] == 0);
    for (uint32_t i = 0; i < N; i++)
        views[i].translation[0] = 7;
    float one_place[N] = { 1, -1, 1, -1, 1, -1, 1, -1 };
    cn_unseen_light(list, NULL, 9, 8, 1, one_place);
    assert_true(one_place[8] == 0);
    float none[1] = { 0 };
    cn_unseen_light(list, NULL, 1, 0, 1, none);
    assert_true(none[0] == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_light_that_changes_slowly_is_followed),
        cmocka_unit_test(a_light_of_its_own_in_each_photo_stays_at_the_mean),
        cmocka_unit_test(a_few_photos_agree_by_chance),
        cmocka_unit_test(a_photo_has_the_light_of_its_run),
        cmocka_unit_test(one_run_tells_nothing),
        cmocka_unit_test(nothing_to_learn_from),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
