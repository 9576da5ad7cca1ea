/* Early stopping: once the last part of training has begun, a stop and a resume do not move its end. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "synthetic.h"

#include "base/file.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

enum { GROWING = 16, GIVEN_UP = 600 };

static synthetic_scene synthetic;
static int stop_flag;
static unsigned values, stop_from;
static uint64_t total;
static bool sleeps; /* once */
static cn_status validate(void *user, double *psnr);
static cn_status (*validator)(void *user, double *psnr) = validate;
static const char *folder_name = "stopping";

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
    if (sleeps) usleep(300000);
    sleeps = false;
    if (r->done >= GIVEN_UP || (stop_from && r->done >= stop_from)) stop_flag = 1;
}

static cn_status train(unsigned until)
{
    const cn_context ctx = { .progress = watch, .stop = &stop_flag };
    const cn_train_input input = { &synthetic.scene, &synthetic.index, synthetic.pixels, &synthetic.tile };
    cn_train_options o = synthetic_options();
    cn_train_result result;
    char dir[128];
    snprintf(dir, sizeof dir, "%s/%s", synthetic.folder, folder_name);
    o.samples_per_step = 4096;
    o.time_budget_s = 1e4; /* more steps than are made, and fewer than a schedule has at most */
    o.stop_gain_db = validator ? 0.1 : 0;
    o.validate_every_s = 0;
    o.validate = validator;
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

/* Ctrl-C while a value is measured. */
static cn_status validate_until_stopped(void *user, double *psnr)
{
    (void)user, (void)psnr;
    if (++values < 3) {
        *psnr = values;
        return CN_OK;
    }
    stop_flag = 1;
    return cn_fail(CN_ERR_INTERRUPTED, "stopped during eval");
}

static void test_a_stop_while_validating_keeps_the_work(void **state)
{
    (void)state;
    char checkpoint[160];
    values = 0;
    validator = validate_until_stopped;
    folder_name = "validating";
    assert_int_equal(train(0), CN_ERR_INTERRUPTED);
    snprintf(checkpoint, sizeof checkpoint, "%s/validating/checkpoint.safetensors", synthetic.folder);
    assert_true(cn_file_exists(checkpoint));
    assert_non_null(strstr(cn_error_message(), "stopped at step 24"));
}

/* The first steps after a resume are slow, for they load the photos. They do not set the schedule's length. */
static void test_a_slow_start_does_not_end_a_budget(void **state)
{
    (void)state;
    validator = NULL;
    folder_name = "budget";
    sleeps = false;
    assert_int_equal(train(96), CN_ERR_INTERRUPTED);
    const uint64_t before = total;
    assert_true(before > 1000);
    sleeps = true;
    assert_int_equal(train(96 + 48), CN_ERR_INTERRUPTED);
    assert_int_equal(total, before);
    /* Later the steps of this process count, without the first ones. */
    sleeps = true;
    assert_int_equal(train(96 + 48 + 80), CN_ERR_INTERRUPTED);
    assert_true(total != before && total > 1000);
}

int main(void)
{
    const struct CMUnitTest tests[] = { cmocka_unit_test(test_a_resume_keeps_the_end),
                                        cmocka_unit_test(test_a_stop_while_validating_keeps_the_work),
                                        cmocka_unit_test(test_a_slow_start_does_not_end_a_budget) };
    return cmocka_run_group_tests(tests, make, unmake);
}
