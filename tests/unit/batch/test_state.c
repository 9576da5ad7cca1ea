/* How far a city is, from its files: tiles that wait, stopped, failed, died or are done; and a first submission. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "base/lock.h"
#include "city/workspace.h"
#include "conurb/batch.h"
#include "fake.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

static cn_city *city;

static void folder(const char *name)
{
    char *path = cn_format("%s/%s", fake_dir(), name);
    assert_int_equal(cn_folder_make(path), CN_OK);
    free(path);
}

static int set_up(void **state)
{
    (void)state;
    fake_begin();
    fake_write("city.yaml", "version: 1\nphotos:\n  folder: photos\nrender:\n  frames: 4\n");
    folder("photos");
    return cn_city_open(&city, fake_dir()) == CN_OK ? 0 : -1;
}

static int tear_down(void **state)
{
    (void)state;
    cn_city_close(&city);
    fake_end();
    return 0;
}

static const cn_work_row *row_of(const cn_city_state *s, const char *stage, const char *item)
{
    for (uint32_t i = 0; i < s->n; i++)
        if (strcmp(s->rows[i].stage, stage) == 0 && strcmp(s->rows[i].item, item) == 0) return &s->rows[i];
    fail_msg("no row of %s %s", stage, item);
    return NULL;
}

/* Takes a lock in another process, which then dies. */
static void die_holding(const char *name)
{
    char *path = cn_format("%s/%s", fake_dir(), name);
    const pid_t child = fork();
    if (child == 0) {
        cn_lock *lock;
        if (cn_lock_take(&lock, path, "a tile") != CN_OK) _exit(1);
        cn_lock_note(lock, "{\"done\": 30, \"total\": 100, \"left_s\": 7}");
        raise(SIGKILL);
    }
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFSIGNALED(status));
    free(path);
}

static void test_tiles(void **state)
{
    (void)state;
    folder("plan");
    fake_write("plan/plan.json", "{\"tiles\": [{\"id\": \"new\"}, {\"id\": \"stopped\"}, {\"id\": \"failed\"},"
                                 "{\"id\": \"dead\"}, {\"id\": \"done\"}, {\"id\": 5}]}");
    static const char *const folders[] = { "tiles/stopped", "tiles/failed", "tiles/dead", "tiles/done" };
    for (int i = 0; i < 4; i++)
        folder(folders[i]);
    fake_write("tiles/stopped/checkpoint.safetensors", "x");
    fake_write("tiles/stopped/log.jsonl", "{\"step\": 10}\n{\"step\": 20, \"psnr\": 17.5}\n{\"step\": 3");
    fake_write("tiles/failed/error.json", "{\"message\": \"the disk is full\"}");
    die_holding("tiles/dead/LOCK");
    fake_write("tiles/done/DONE", "x");
    fake_write("tiles/done/error.json", "{\"message\": \"of an earlier run\"}");
    fake_write("tiles/done/metrics.json", "{\"steps\": 100, \"train_psnr\": 25, \"arena_bytes\": 1000}");
    cn_city_state s;
    assert_int_equal(cn_city_state_read(&fake_ctx, city, &s), CN_OK);
    assert_int_equal(row_of(&s, "train", "new")->work, CN_WORK_WAITING);
    /* The last line of the log is not whole: the one before it counts. */
    assert_int_equal(row_of(&s, "train", "stopped")->work, CN_WORK_STOPPED);
    assert_true(row_of(&s, "train", "stopped")->done == 20 && row_of(&s, "train", "stopped")->psnr == 17.5);
    assert_int_equal(row_of(&s, "train", "failed")->work, CN_WORK_FAILED);
    assert_string_equal(row_of(&s, "train", "failed")->note, "the disk is full");
    const cn_work_row *dead = row_of(&s, "train", "dead"), *done = row_of(&s, "train", "done");
    assert_int_equal(dead->work, CN_WORK_LOST);
    assert_true(dead->done == 30 && dead->total == 100 && dead->heartbeat_s >= 0);
    assert_non_null(strstr(dead->note, "run the same command to resume"));
    assert_int_equal(done->work, CN_WORK_DONE);
    assert_true(done->done == 100 && done->psnr == 25 && done->memory_bytes == 1000 && !done->note[0]);
    assert_int_equal(s.n_tiles, 5);
    for (int w = CN_WORK_STOPPED; w <= CN_WORK_DONE; w++)
        assert_int_equal(s.tiles[w], 1);
    assert_true(s.left_s < 0); /* nothing runs: a dead process has no time left */
    char *json;
    assert_int_equal(cn_city_state_json(&s, &json), CN_OK);
    assert_non_null(strstr(json, "\"the disk is full\""));
    free(json);
    cn_city_state_deinit(&s);
}

/* What a tile does before its first step is told by its name: photos are no steps. */
static void test_before_the_first_step(void **state)
{
    (void)state;
    folder("plan");
    folder("tiles/a");
    fake_write("plan/plan.json", "{\"tiles\": [{\"id\": \"a\"}]}");
    char *path = cn_format("%s/tiles/a/LOCK", fake_dir());
    cn_lock *lock;
    assert_int_equal(cn_lock_take(&lock, path, "a tile"), CN_OK);
    cn_lock_note(lock, "{\"stage\": \"stereo\", \"done\": 5, \"total\": 16, \"left_s\": 7}");
    cn_city_state s;
    assert_int_equal(cn_city_state_read(&fake_ctx, city, &s), CN_OK);
    const cn_work_row *row = row_of(&s, "train", "a");
    assert_int_equal(row->work, CN_WORK_RUNNING);
    assert_true(row->done == 0 && row->total == 0 && row->left_s < 0 && s.left_s < 0);
    assert_string_equal(row->note, "stereo: 5 of 16");
    cn_city_state_deinit(&s);
    cn_lock_note(lock, "{\"stage\": \"train\", \"done\": 5, \"total\": 60, \"left_s\": 7}");
    assert_int_equal(cn_city_state_read(&fake_ctx, city, &s), CN_OK);
    row = row_of(&s, "train", "a");
    assert_true(row->done == 5 && row->total == 60 && row->left_s == 7 && !row->note[0]);
    cn_city_state_deinit(&s);
    cn_lock_release(&lock);
    free(path);
}

/* Files that a machine which failed left half written do not stop the others. */
static void test_damaged_files(void **state)
{
    (void)state;
    folder("plan");
    fake_write("plan/plan.json", "{\"tiles\": [{\"id\": \"a\"}]}");
    folder("tiles/a");
    fake_write("tiles/a/error.json", "{\"message\": ");
    fake_write("tiles/a/log.jsonl", "no JSON\n");
    cn_city_state s;
    assert_int_equal(cn_city_state_read(&fake_ctx, city, &s), CN_OK);
    const cn_work_row *row = row_of(&s, "train", "a");
    assert_true(row->work == CN_WORK_WAITING && row->done == 0 && isnan(row->psnr));
    cn_city_state_deinit(&s);
    fake_write("plan/plan.json", "{\"tiles\": ");
    assert_int_equal(cn_city_state_read(&fake_ctx, city, &s), CN_OK);
    assert_int_equal(s.n_tiles, 0);
    cn_city_state_deinit(&s);
}

/* Without a plan one job is submitted, which makes poses and plan. It is not submitted again while it is in the queue,
 * and is once it has left the queue without having made them. */
static void test_first_submission(void **state)
{
    (void)state;
    const cn_submit_options options = { .program = "/opt/conurb", .max_tasks = 3, .cpus = 2 };
    fake_program("sbatch", "echo 70");
    fake_program("squeue", "cat \"${0%/*}/queue\"");
    fake_write("queue", "");
    assert_int_equal(cn_city_submit(&fake_ctx, city, &options), CN_OK);
    char *calls = fake_read("calls");
    assert_non_null(strstr(calls, "--parsable\n/"));
    assert_non_null(strstr(calls, "/jobs/prepare-"));
    assert_null(strstr(calls, "--dependency"));
    free(calls);
    fake_write("calls", "");
    fake_write("queue", "70|PENDING||(Priority)\n");
    assert_int_equal(cn_city_submit(&fake_ctx, city, &options), CN_OK);
    calls = fake_read("calls");
    assert_null(strstr(calls, "--parsable"));
    free(calls);
    assert_non_null(strstr(fake_log(), "nothing to submit"));
    /* What is in a queue that does not answer is not submitted again. */
    fake_program("squeue", "echo 'no controller' >&2; exit 1");
    fake_write("calls", "");
    assert_int_equal(cn_city_submit(&fake_ctx, city, &options), CN_ERR_TOOL);
    assert_non_null(strstr(cn_error_message(), "squeue ended with 1: no controller"));
    cn_city_state queue;
    char *json;
    assert_int_equal(cn_city_state_read(&fake_ctx, city, &queue), CN_OK);
    assert_int_equal(cn_city_state_json(&queue, &json), CN_OK);
    assert_non_null(strstr(json, "\"queue\":\"squeue ended with 1: no controller\""));
    free(json);
    cn_city_state_deinit(&queue);
    calls = fake_read("calls");
    assert_null(strstr(calls, "--parsable"));
    free(calls);
    fake_program("squeue", "cat \"${0%/*}/queue\"");
    fake_write("calls", "");
    fake_write("queue", "");
    assert_int_equal(cn_city_submit(&fake_ctx, city, &options), CN_OK);
    calls = fake_read("calls");
    assert_non_null(strstr(calls, "--parsable\n/"));
    free(calls);
}

/* Submissions at once do not lose each other's jobs, nor submit a stage twice. */
static void test_two_submissions_at_once(void **state)
{
    (void)state;
    const cn_submit_options options = { .program = "/opt/conurb" };
    fake_program("sbatch", "sleep 0.5; echo '70|PENDING||(Priority)' >\"${0%/*}/queue\"; echo 70");
    fake_program("squeue", "cat \"${0%/*}/queue\"");
    fake_write("queue", "");
    const pid_t other = fork();
    if (other == 0) _exit(cn_city_submit(&fake_ctx, city, &options) == CN_OK ? 0 : 1);
    assert_int_equal(cn_city_submit(&fake_ctx, city, &options), CN_OK);
    int status;
    assert_int_equal(waitpid(other, &status, 0), other);
    assert_int_equal(status, 0);
    char *calls = fake_read("calls");
    const char *first = strstr(calls, "--parsable");
    assert_non_null(first);
    assert_null(strstr(first + 1, "--parsable"));
    free(calls);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_tiles, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_before_the_first_step, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_damaged_files, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_first_submission, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_two_submissions_at_once, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
