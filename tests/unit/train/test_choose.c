/* Settings chosen for a time budget: the fastest when there is little time, the richest when there is much, and always
 * those that the model expects to do best with the steps that fit. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "synthetic.h"
#include "train/choose.h"

#include <math.h>
#include <string.h>

enum { SMALL, MIDDLE, LARGE, WAYS };

static void set(cn_candidate candidates[WAYS], double small_s, double middle_s, double large_s)
{
    candidates[SMALL] = (cn_candidate){ .quality = CN_QUALITY_PREVIEW, .step_s = small_s };
    candidates[MIDDLE] = (cn_candidate){ .quality = CN_QUALITY_STANDARD, .step_s = middle_s };
    candidates[LARGE] = (cn_candidate){ .quality = CN_QUALITY_REFERENCE, .step_s = large_s };
}

static void test_by_time(void **state)
{
    (void)state;
    cn_candidate candidates[WAYS];
    set(candidates, 0.010, 0.020, 0.060);
    size_t last = SMALL;
    bool seen[WAYS] = { false };
    for (double budget = 1; budget < 1e5; budget *= 1.1) {
        const size_t best = cn_train_choose_best(candidates, WAYS, budget);
        for (size_t i = 0; i < WAYS; i++) {
            assert_true(candidates[i].steps * candidates[i].step_s <= budget &&
                        (candidates[i].steps + 1) * candidates[i].step_s > budget);
            assert_true(candidates[i].expected_db == cn_train_expected_db(candidates[i].quality, candidates[i].steps));
            assert_true(candidates[best].expected_db >= candidates[i].expected_db);
        }
        assert_true(best >= last); /* more time never asks for less */
        last = best;
        seen[best] = true;
    }
    assert_true(seen[SMALL] && seen[MIDDLE] && seen[LARGE]);
}

/* The choice depends on the machine's speed as well as on the budget. */
static void test_by_speed(void **state)
{
    (void)state;
    cn_candidate candidates[WAYS];
    set(candidates, 0.020, 0.020, 0.020);
    assert_int_equal(cn_train_choose_best(candidates, WAYS, 600), LARGE); /* what costs nothing is taken */
    set(candidates, 0.020, 0.020, 20);
    assert_int_equal(cn_train_choose_best(candidates, WAYS, 600), MIDDLE);
    set(candidates, 0.020, 20, 20);
    assert_int_equal(cn_train_choose_best(candidates, WAYS, 600), SMALL);
    set(candidates, 0.020, 0, 0.020); /* no room */
    assert_int_equal(cn_train_choose_best(candidates, WAYS, 600), LARGE);
    assert_true(candidates[MIDDLE].steps == 0 && candidates[MIDDLE].expected_db == -INFINITY);
    set(candidates, 0.020, 0.020, 0.020);
    assert_int_equal(cn_train_choose_best(candidates, WAYS, 0.001), SMALL); /* not even a step of any */
}

static void test_expected(void **state)
{
    (void)state;
    for (int q = CN_QUALITY_PREVIEW; q <= CN_QUALITY_REFERENCE; q++)
        for (double steps = 1; steps < 1e6; steps *= 2)
            assert_true(cn_train_expected_db((cn_quality)q, 2 * steps) > cn_train_expected_db((cn_quality)q, steps));
    assert_true(cn_train_expected_db(CN_QUALITY_HIGH, 500) == cn_train_expected_db(CN_QUALITY_STANDARD, 500));
}

/* The choice on this machine, and on one with little memory. */
static void test_measured(void **state)
{
    (void)state;
    synthetic_scene synthetic;
    synthetic_scene_init(&synthetic, 17);
    cn_train_options request = cn_train_options_preset(CN_QUALITY_STANDARD);
    request.seed = 17;
    request.time_budget_s = 30;
    request.choose = true;
    request.leave_out_occluders = false;
    const cn_train_options small = cn_train_options_within(&request, CN_QUALITY_PREVIEW);
    const cn_context ctx = { 0 };
    cn_train_speed *speed;
    cn_train_choice choice;
    double seconds;
    uint64_t bytes;
    cn_train_cost(&small, &synthetic.tile, &seconds, &bytes);
    assert_int_equal(cn_train_speed_create(&speed, NULL), CN_OK);
    assert_int_equal(cn_train_choose(&ctx, speed, &request, &synthetic.tile, bytes, &choice), CN_OK);
    assert_true(choice.quality == CN_QUALITY_PREVIEW && choice.bytes <= bytes &&
                memcmp(&choice.options.field, &small.field, sizeof small.field) == 0);
    assert_false(choice.options.leave_out_occluders);
    assert_true(choice.options.seed == 17 && choice.options.time_budget_s == 30 && !choice.options.choose);
    cn_train_options predicted = choice.options;
    predicted.time_budget_s = 0;
    assert_int_equal(cn_train_speed_predict(&ctx, speed, &predicted, &synthetic.tile, &seconds, &bytes), CN_OK);
    /* The steps fill the time: not one more fits. An emulated processor takes seconds for a step. */
    assert_true(predicted.steps >= 1 && seconds < 30.5 && seconds + seconds / predicted.steps > 29.5);
    cn_train_speed_destroy(&speed);
    synthetic_scene_deinit(&synthetic);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_by_time),
        cmocka_unit_test(test_by_speed),
        cmocka_unit_test(test_expected),
        cmocka_unit_test(test_measured),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
