/* squeue's lines become states of tiles and stages. squeue is a script. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "batch/queue.h"
#include "city/workspace.h"
#include "fake.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { POSES, PLAN, TILE_A, TILE_B, MATCH, RENDER, ROWS };
static cn_city city;
static cn_work_row rows[ROWS];
static cn_city_state known = { .rows = rows, .n = ROWS };

static int set_up(void **state)
{
    (void)state;
    static const char *const stages[ROWS] = { "poses", "plan", "train", "train", "match", "render" };
    fake_begin();
    memset(rows, 0, sizeof rows);
    for (int i = 0; i < ROWS; i++)
        strcpy(rows[i].stage, stages[i]);
    strcpy(rows[TILE_A].item, "A1");
    strcpy(rows[TILE_B].item, "B2");
    city = (cn_city){ .folder = strdup(fake_dir()) };
    char *jobs = cn_city_path(&city, "jobs");
    const cn_status status = cn_folder_make(jobs);
    free(jobs);
    fake_write("jobs/submission.json",
               "{\"engine\": \"slurm\", \"jobs\": [{\"stage\": \"prepare\", \"id\": \"9\", \"items\": []},"
               "{\"stage\": \"train\", \"id\": \"12\", \"items\": [\"A1\", \"B2\"]},"
               "{\"stage\": \"match\", \"id\": \"13\", \"items\": []},"
               "{\"stage\": \"render\", \"id\": \"14\", \"items\": [\"1/2\", \"2/2\"]}]}");
    return status == CN_OK ? 0 : -1;
}

static int tear_down(void **state)
{
    (void)state;
    free(city.folder);
    fake_end();
    return 0;
}

static void join(const char *script)
{
    fake_program("squeue", script);
    cn_queue_join(&fake_ctx, &city, &known);
}

static void test_states(void **state)
{
    (void)state;
    join("echo '12_1|RUNNING|node1|None'; echo '12_2|PENDING||(Resources)'; echo '13|PENDING||(Dependency)'\n"
         "echo '14_2|REQUEUED|node2|(BeginTime)'");
    char *calls = fake_read("calls");
    assert_non_null(strstr(calls, "--array\n--jobs\n9,12,13,14\n"));
    free(calls);
    static const char *const where[ROWS] = { "",
                                             "",
                                             "job 12_1 RUNNING node1",
                                             "job 12_2 PENDING (Resources)",
                                             "job 13 PENDING (Dependency)",
                                             "job 14_2 REQUEUED (BeginTime)" };
    for (int i = 0; i < ROWS; i++) {
        assert_string_equal(rows[i].where, where[i]);
        assert_int_equal(rows[i].work, *where[i] ? CN_WORK_QUEUED : CN_WORK_WAITING);
    }
}

/* The disk knows better: what is done stays done, a process at work keeps its place, a dead one is told apart. */
static void test_the_disk_comes_first(void **state)
{
    (void)state;
    rows[TILE_A].work = CN_WORK_DONE;
    strcpy(rows[TILE_A].where, "");
    rows[TILE_B].work = CN_WORK_RUNNING;
    strcpy(rows[TILE_B].where, "node1, pid 7");
    rows[MATCH].work = CN_WORK_LOST;
    rows[RENDER].work = CN_WORK_LOST;
    join("echo '12_1|COMPLETING|node1|None'; echo '12_2|RUNNING|node1|None'; echo '13|RUNNING|node3|None'\n"
         "echo '14_1|PENDING||(BeginTime)'");
    assert_int_equal(rows[TILE_A].work, CN_WORK_DONE);
    assert_string_equal(rows[TILE_A].where, "");
    assert_int_equal(rows[TILE_B].work, CN_WORK_RUNNING);
    assert_string_equal(rows[TILE_B].where, "node1, pid 7, job 12_2");
    /* Killed, and the queue has not noticed. */
    assert_int_equal(rows[MATCH].work, CN_WORK_LOST);
    assert_string_equal(rows[MATCH].note, "the queue still says RUNNING");
    /* Killed, and in the queue again. */
    assert_int_equal(rows[RENDER].work, CN_WORK_QUEUED);
}

static void expect_untouched(void)
{
    for (int i = 0; i < ROWS; i++)
        if (rows[i].work != CN_WORK_WAITING || rows[i].where[0] || rows[i].note[0])
            fail_msg("%s %s is %s: %s", rows[i].stage, rows[i].item, cn_work_name(rows[i].work), rows[i].where);
}

/* Lines of other jobs, and lines that squeue never printed. */
static void test_strange_lines(void **state)
{
    (void)state;
    join("echo '1|RUNNING|node1|None'; echo '120_1|RUNNING|node1|None'; echo '12_3|RUNNING|node1|None'\n"
         "echo '12_99999999999999999999|RUNNING|node1|None'; echo '12_-1|RUNNING'; echo; echo '|||'; echo '12_1'\n"
         "echo '12_1|RUNNING'; echo '12_1|RUNNING|node1'; echo 'slurm_load_jobs error: Invalid job id'; exit 1");
    expect_untouched();
    /* Longer than a row's text. */
    join("printf '12_1|RUNNING|'; head -c 300 /dev/zero | tr '\\0' n; echo '|None'");
    assert_int_equal(rows[TILE_A].work, CN_WORK_QUEUED);
    assert_true(strlen(rows[TILE_A].where) < sizeof rows[TILE_A].where);
}

static void test_nothing_to_ask(void **state)
{
    (void)state;
    static const char *const records[] = { "{\"engine\": \"slurm\", \"jobs\": []}",
                                           "{\"engine\": \"kubernetes\", \"jobs\": [{\"id\": \"12\"}]}",
                                           "{\"jobs\": [{\"id\": \"12\"}]}",
                                           "[1]",
                                           "{\"engine\": \"slurm\"",
                                           "" };
    for (size_t i = 0; i < sizeof records / sizeof *records; i++) {
        fake_write("jobs/submission.json", records[i]);
        join("echo '12_1|RUNNING|node1|None'");
        char *calls = fake_read("calls");
        assert_string_equal(calls, "");
        free(calls);
        expect_untouched();
    }
}

/* Members of another kind than they should be. */
static void test_a_damaged_record(void **state)
{
    (void)state;
    fake_write("jobs/submission.json",
               "{\"engine\": \"slurm\", \"jobs\": [7, {\"id\": 12}, {\"id\": \"12\"}, {\"stage\": \"train\", \"id\": "
               "\"12\", \"items\": [3]}, {\"stage\": \"train\", \"id\": \"12\", \"items\": 4},"
               "{\"stage\": \"none\", \"id\": \"12\", \"items\": [\"A1\"]},"
               "{\"stage\": \"train\", \"id\": \"1234567890123456789012345678901234567890\", \"items\": [\"A1\"]}]}");
    join("echo '12_1|RUNNING|node1|None'");
    expect_untouched();
}

static void test_no_squeue(void **state)
{
    (void)state;
    fake_no_program();
    cn_queue_join(&fake_ctx, &city, &known);
    expect_untouched();
    assert_non_null(strstr(fake_log(), "the queue is not known: cannot run squeue"));
}

/* A squeue that fails says nothing of the jobs. When all of them have left the queue, it fails too, and that is known.
 */
static void test_squeue_fails(void **state)
{
    (void)state;
    join(
        "echo '12_1|RUNNING|node1|None'; echo 'slurm_load_jobs error: Unable to contact slurm controller' >&2; exit 1");
    assert_string_equal(known.queue, "squeue ended with 1: slurm_load_jobs error: Unable to contact slurm controller");
    assert_int_equal(rows[TILE_A].work, CN_WORK_QUEUED);
    known.queue[0] = '\0';
    join("echo 'slurm_load_jobs error: Invalid job id specified' >&2; exit 1");
    assert_string_equal(known.queue, "");
    fake_no_program();
    cn_queue_join(&fake_ctx, &city, &known);
    assert_string_equal(known.queue, "");
}

/* One job makes the poses and then the plan. */
static void test_prepare(void **state)
{
    (void)state;
    join("echo '9|PENDING||(Priority)'");
    assert_int_equal(rows[POSES].work, CN_WORK_QUEUED);
    assert_string_equal(rows[POSES].where, "job 9 PENDING (Priority)");
    assert_int_equal(rows[PLAN].work, CN_WORK_WAITING);
    memset(rows[POSES].where, 0, sizeof rows[POSES].where);
    rows[POSES].work = CN_WORK_DONE;
    join("echo '9|RUNNING|node1|None'");
    assert_string_equal(rows[POSES].where, "");
    assert_string_equal(rows[PLAN].where, "job 9 RUNNING node1");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_states, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_the_disk_comes_first, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_strange_lines, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_nothing_to_ask, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_damaged_record, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_no_squeue, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_squeue_fails, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_prepare, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
