#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>

#include <cmocka.h>

#include "conurb/base.h"

#include <sched.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#define ITEMS 1000

typedef struct tally {
    unsigned char visits[ITEMS];
    unsigned threads;
    atomic_uint bad_workers;
    double sums[16 * 8]; /* one a worker, plain memory: a race here is for the thread sanitizer to find */
} tally;

static void visit(void *user, size_t i, unsigned worker)
{
    tally *t = user;
    t->visits[i]++;
    if (worker >= t->threads)
        atomic_fetch_add(&t->bad_workers, 1);
    else
        t->sums[worker * 8] += (double)i;
}

static void check_run(cn_pool *pool, size_t n)
{
    tally *t = calloc(1, sizeof *t);
    assert_non_null(t);
    t->threads = cn_pool_threads(pool);
    cn_pool_run(pool, n, visit, t);
    double sum = 0;
    for (unsigned k = 0; k < t->threads; k++)
        sum += t->sums[k * 8];
    for (size_t i = 0; i < ITEMS; i++)
        assert_int_equal(t->visits[i], i < n);
    assert_int_equal(t->bad_workers, 0);
    assert_true(sum == (double)n * ((double)n - 1) / 2);
    free(t);
}

static void every_item_runs_once(void **state)
{
    (void)state;
    const unsigned threads[] = { 1, 2, 3, 7, 16 };
    const size_t counts[] = { 0, 1, 2, 3, 15, 16, 17, ITEMS };
    for (size_t k = 0; k < sizeof threads / sizeof *threads; k++) {
        cn_pool *pool;
        assert_int_equal(cn_pool_create(&pool, threads[k]), CN_OK);
        assert_int_equal(cn_pool_threads(pool), threads[k]);
        for (size_t c = 0; c < sizeof counts / sizeof *counts; c++)
            check_run(pool, counts[c]);
        cn_pool_destroy(&pool);
        assert_null(pool);
    }
}

static void a_pool_is_used_again_and_again(void **state)
{
    (void)state;
    cn_pool *pool;
    assert_int_equal(cn_pool_create(&pool, 4), CN_OK);
    for (int round = 0; round < 500; round++)
        check_run(pool, (size_t)(round % 40));
    cn_pool_destroy(&pool);
}

static void an_unused_pool_can_go(void **state)
{
    (void)state;
    for (int round = 0; round < 50; round++) {
        cn_pool *pool;
        assert_int_equal(cn_pool_create(&pool, 3), CN_OK);
        cn_pool_destroy(&pool);
    }
    cn_pool *none = NULL;
    cn_pool_destroy(&none);
}

static void in_order(void *user, size_t i, unsigned worker)
{
    size_t *next = user;
    assert_int_equal(worker, 0);
    assert_int_equal(i, (*next)++);
}

static void no_pool_is_serial_and_in_order(void **state)
{
    (void)state;
    size_t next = 0;
    assert_int_equal(cn_pool_threads(NULL), 1);
    check_run(NULL, 37);
    cn_pool_run(NULL, 37, in_order, &next);
    assert_int_equal(next, 37);
}

static void zero_threads_means_the_processors_allowed(void **state)
{
    (void)state;
    cpu_set_t before, one;
    if (sched_getaffinity(0, sizeof before, &before) != 0) skip(); /* more processors than a plain cpu_set_t holds */
    cn_pool *pool;
    assert_int_equal(cn_pool_create(&pool, 0), CN_OK);
    assert_int_equal(cn_pool_threads(pool), CPU_COUNT(&before));
    cn_pool_destroy(&pool);

    CPU_ZERO(&one);
    for (int cpu = 0; cpu < CPU_SETSIZE && CPU_COUNT(&one) == 0; cpu++)
        if (CPU_ISSET(cpu, &before)) CPU_SET(cpu, &one);
    assert_int_equal(sched_setaffinity(0, sizeof one, &one), 0);
    cn_status status = cn_pool_create(&pool, 0);
    sched_setaffinity(0, sizeof before, &before);
    assert_int_equal(status, CN_OK);
    assert_int_equal(cn_pool_threads(pool), 1);
    cn_pool_destroy(&pool);
}

static void absurd_thread_counts_are_refused(void **state)
{
    (void)state;
    cn_pool *pool;
    assert_int_equal(cn_pool_create(&pool, 1000000), CN_ERR_USAGE);
    assert_null(pool);
    assert_non_null(strstr(cn_error_message(), "1000000"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_item_runs_once),
        cmocka_unit_test(a_pool_is_used_again_and_again),
        cmocka_unit_test(an_unused_pool_can_go),
        cmocka_unit_test(no_pool_is_serial_and_in_order),
        cmocka_unit_test(zero_threads_means_the_processors_allowed),
        cmocka_unit_test(absurd_thread_counts_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
