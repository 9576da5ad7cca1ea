/* Early stopping: once the last part of training has begun, a stop and a resume do not move its end. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "synthetic.h"

#include <stdio.h>
#include <string.h>

enum { GROWING = 16, GIVEN_UP = 600 };

static synthetic_scene synthetic;
static int stop_flag;
static unsigned values, stop_from;
static uint64_t total;

static int make(void **state)
{
    (void)state;
    synthetic_scene_init(&synthetic, 9);
    return 0;
}
static int unmake(void **state)
{
    (void)state;
    synthetic_scene_deinit(&synthetic);
    return 0;
}

/* A PSNR that rises fast and then stays: the curve is flat four values later. */
static cn_status validate(void *user, double *psnr)
{
    (void)user;
    values++;
    *psnr = 10.0 * (values < GROWING ? values : GROWING);
    return CN_OK;
}

/* Reports come every eight steps. The test gives up when the schedule has no end. */
static void watch(void *user, const cn_progress_report *r)
{
    (void)user;
    total = (uint64_t)r->total;
    if (r->done >= GIVEN_UP || (stop_from && r->done >= stop_from)) stop_flag = 1;
}

static cn_status train(unsigned until)
{
    const cn_context ctx = { .progress = watch, .stop = &stop_flag };
    const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
    cn_train_options o = synthetic_options();
    cn_train_result result;
    char dir[128];
    snprintf(dir, sizeof dir, "%s/stopping", synthetic.folder);
    o.samples_per_step = 4096;
    o.time_budget_s = 1e6;
    o.stop_gain_db = 0.1;
    o.validate_every_s = 0;
    o.validate = validate;
    stop_from = until;
    stop_flag = 0;
    return cn_train_tile(&ctx, &input, &o, "parent", dir, &result);
}

static void test_a_resume_keeps_the_end(void **state)
{
    (void)state;
    assert_int_equal(train(8 * (GROWING + 3) + 8), CN_ERR_INTERRUPTED);
    const uint64_t end = total;
    const unsigned n = values;
    assert_true(end < 250 && n == GROWING + 3);
    assert_int_equal(train(0), CN_OK);
    assert_int_equal(total, end);
    assert_int_equal(values, n); /* nothing is left to decide */
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_a_resume_keeps_the_end) };
    return cmocka_run_group_tests(tests, make, unmake);
}
