/* What is handed to Slurm, and what is made of sbatch's answers. sbatch is a script. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "base/json.h"
#include "batch/submit.h"
#include "fake.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static cn_city city;
static cn_submit_options options;
static cn_submission submission;
static const char *tiles[] = { "A1", "B2", "C3" };

static void add_job(const char *stage, uint32_t n)
{
    cn_submit_job *job = &submission.jobs[submission.n_jobs++];
    *job = (cn_submit_job){ .stage = stage, .items = tiles, .n = n, .cpus = 4, .minutes = 50, .memory_mb = 2048 };
    job->list = cn_format("%s/%s-0123abcd.items", submission.dir, stage);
}

static int set_up(void **state)
{
    (void)state;
    options = (cn_submit_options){ .program = "/opt/conurb 1/bin/conurb" };
    fake_submission_begin(&submission, &city, &options, "old town's");
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    fake_submission_end(&submission, &city);
    return 0;
}

/* The id of job i on record; "" when there is none. The caller frees it. */
static char *recorded(size_t i, size_t *n)
{
    char *text = fake_read("old town's/jobs/submission.json");
    json_t *root = *text ? json_loads(text, 0, NULL) : NULL;
    const json_t *jobs = json_object_get(root, "jobs");
    const char *id = json_string_value(json_object_get(json_array_get(jobs, i), "id"));
    char *copy = strdup(id ? id : "");
    if (n) *n = json_array_size(jobs);
    json_decref(root);
    free(text);
    return copy;
}

static void expect_recorded(const char *first, const char *last, size_t n)
{
    size_t found;
    char *a = recorded(0, &found), *b = recorded(n ? n - 1 : 0, NULL);
    assert_int_equal(found, n);
    assert_string_equal(a, first);
    assert_string_equal(b, last);
    free(a);
    free(b);
}

/* A folder's blanks and quotes reach neither the shell nor sbatch as such. bash accepts the script. */
static void test_script(void **state)
{
    (void)state;
    options.quality = "high";
    add_job("train", 3);
    fake_program("sbatch", "echo 12");
    assert_int_equal(cn_submit_slurm(&submission), CN_OK);
    char *text = fake_read("old town's/jobs/train-0123abcd.sbatch");
    static const char *const lines[] = { "#SBATCH --cpus-per-task=4\n",
                                         "#SBATCH --mem=2048M\n",
                                         "#SBATCH --time=50\n",
                                         "#SBATCH --job-name=old\\ town\\'s-train\n",
                                         "/old\\ town\\'s/jobs/logs/train-%A_%a.log\n",
                                         "/old town'\\''s'\n",
                                         "conurb='/opt/conurb 1/bin/conurb'\n",
                                         "--quality high" };
    for (size_t i = 0; i < sizeof lines / sizeof *lines; i++)
        if (!strstr(text, lines[i])) fail_msg("the script lacks %s", lines[i]);
    assert_null(strstr(text, "{{"));
    free(text);
    char *command = cn_format("bash -n \"%s/old town's/jobs/train-0123abcd.sbatch\"", fake_dir());
    assert_int_equal(system(command), 0);
    free(command);
    char *calls = fake_read("calls");
    assert_non_null(strstr(calls, "--parsable\n--array=1-3\n/"));
    assert_null(strstr(calls, "--dependency"));
    free(calls);
    expect_recorded("12", "12", 1);
}

/* A task of the script: conurb is a script that ends in each way. 75 is put back into the queue, 0 and 6 are not, nor
 * what scancel ended. The task is the last of its array, whose number is that of the array: only this task is put back.
 */
static void test_a_task_that_ends(void **state)
{
    (void)state;
    static const int codes[] = { 0, 6, 75, 75, 137 };
    static const char *const jobs[] = { "RUNNING", "RUNNING", "RUNNING", "COMPLETING", "RUNNING" };
    for (size_t i = 0; i < sizeof codes / sizeof *codes; i++) {
        tear_down(NULL);
        assert_int_equal(set_up(NULL), 0);
        char *program = cn_format("%s/conurb", fake_dir()), end[32], said[64];
        options.program = program;
        options.device = "gpu:1";
        add_job("train", 3);
        fake_write("old town's/jobs/train-0123abcd.items", "A1\nB2\nC3\n");
        fake_program("sbatch", "echo 12");
        assert_int_equal(cn_submit_slurm(&submission), CN_OK);
        fake_write("calls", "");
        snprintf(said, sizeof said, "[ \"$2\" != job ] || echo JobState=%s", jobs[i]);
        fake_program("scontrol", said);
        snprintf(end, sizeof end, codes[i] == 137 ? "kill -9 $$" : "exit %d", codes[i]);
        fake_program("conurb", end);
        char *command = cn_format("SLURM_ARRAY_JOB_ID=12 SLURM_ARRAY_TASK_ID=2 SLURM_JOB_ID=12 bash "
                                  "\"%s/old town's/jobs/train-0123abcd.sbatch\" 2>/dev/null",
                                  fake_dir());
        const int status = system(command);
        assert_int_equal(status >> 8, codes[i]);
        char *calls = fake_read("calls");
        assert_non_null(strstr(calls, "train\n"));
        assert_non_null(strstr(calls, "--tile\nB2\n--threads\n4\n--device\ngpu:1\n"));
        assert_int_equal(strstr(calls, "requeue\n12_2\n") != NULL, codes[i] == 75 && strcmp(jobs[i], "RUNNING") == 0);
        assert_null(strstr(calls, "requeue\n12\n"));
        free(calls);
        free(command);
        free(program);
    }
}

/* The job that makes poses and plan submits the rest with the same program, on the same device. */
static void test_what_a_job_submits(void **state)
{
    (void)state;
    options.device = "gpu:1";
    add_job("prepare", 0);
    fake_program("sbatch", "echo 12");
    assert_int_equal(cn_submit_slurm(&submission), CN_OK);
    char *text = fake_read("old town's/jobs/prepare-0123abcd.sbatch");
    assert_non_null(strstr(text, " --program '/opt/conurb 1/bin/conurb' --device 'gpu:1' || code=$?"));
    assert_non_null(strstr(text, "/jobs/logs/prepare-%j.log\n"));
    free(text);
}

/* Renders wait for the tiles and the match, of this submission and of earlier ones. A failed tile cancels them. */
static void test_dependencies(void **state)
{
    (void)state;
    options.max_tasks = 2;
    strcpy(submission.live, ":7:8");
    strcpy(submission.live_match, ":9");
    add_job("train", 3);
    add_job("eval", 0);
    add_job("match", 0);
    add_job("render", 2);
    char script[256];
    snprintf(script, sizeof script, "echo x >>'%s/n'; echo \"$((20 + $(wc -l <'%s/n')));night\"", fake_dir(),
             fake_dir());
    fake_program("sbatch", script);
    assert_int_equal(cn_submit_slurm(&submission), CN_OK);
    char *calls = fake_read("calls");
    assert_non_null(strstr(calls, "--parsable\n--array=1-3%2\n/"));
    assert_non_null(strstr(calls, "--parsable\n--dependency=afterok:21:7:8\n--kill-on-invalid-dep=yes\n/"));
    assert_non_null(strstr(calls, "--array=1-2%2\n--dependency=afterok:21:7:8:23:9\n--kill-on-invalid-dep=yes\n/"));
    free(calls);
    expect_recorded("21", "24", 4);
}

static size_t lines_of(const char *text)
{
    size_t n = 0;
    for (const char *c = text; (c = strchr(c, '\n')); c++)
        n++;
    return n;
}

/* Slurm takes 1000 tasks in an array: 2100 tiles are three, and what follows waits for them all. */
static void test_more_tasks_than_an_array_has(void **state)
{
    (void)state;
    enum { TILES = 2100 };
    static char names[TILES][8];
    static const char *many[TILES];
    for (int i = 0; i < TILES; i++) {
        snprintf(names[i], sizeof names[i], "T%d", i);
        many[i] = names[i];
    }
    for (int limited = 0; limited < 2; limited++) {
        tear_down(NULL);
        assert_int_equal(set_up(NULL), 0);
        fake_program("sbatch", "d=${0%/*}; echo x >>\"$d/n\"; echo $((20 + $(wc -l <\"$d/n\")))");
        options.max_tasks = limited ? 50 : 0;
        add_job("train", TILES);
        submission.jobs[0].items = many;
        add_job("eval", 0);
        assert_int_equal(cn_submit_slurm(&submission), CN_OK);
        char *calls = fake_read("calls");
        const char *limit = limited ? "%50\n--dependency=afterany:22\n--kill-on-invalid-dep=yes\n/" : "\n/";
        char *third = cn_format("--parsable\n--array=1-100%s", limit);
        const char *script = strstr(calls, third);
        assert_non_null(script);
        assert_null(strstr(calls, "--array=1-2100"));
        assert_non_null(strstr(calls, "--dependency=afterok:21:22:23\n"));
        /* The list beside the third script is of the last tiles. */
        script += strlen(third) - 1;
        char *list = cn_format("%.*s.items", (int)(strcspn(script, "\n") - strlen(".sbatch")), script), *items;
        size_t size;
        assert_int_equal(cn_file_read(list, 1 << 20, &items, &size), CN_OK);
        assert_int_equal(lines_of(items), 100);
        assert_memory_equal(items, "T2000\n", 6);
        free(items);
        free(list);
        free(third);
        free(calls);
        expect_recorded("21", "24", 4);
    }
}

/* What sites print around the id does not become the id. */
static void test_answers(void **state)
{
    (void)state;
    static const char *const good[] = { "echo 34", "echo '34;cluster'", "echo 'sbatch: warning: 5 nodes'; echo 34",
                                        "echo 34; echo '2 hours of your budget are left'" };
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        tear_down(NULL);
        assert_int_equal(set_up(NULL), 0);
        add_job("train", 3);
        fake_program("sbatch", good[i]);
        assert_int_equal(cn_submit_slurm(&submission), CN_OK);
        expect_recorded("34", "34", 1);
    }
    static const struct {
        const char *script, *message;
    } bad[] = { { "echo 'sbatch: error: invalid partition'; exit 1", "invalid partition" },
                { "exit 1", "it said nothing" },
                { "true", "it said nothing" },
                { "echo 34; exit 1", "sbatch refused" },
                { "echo 'Submitted batch job 34'", "Submitted batch job 34" },
                { "echo 99999999999999999999999999999999999999", "sbatch refused" },
                { "kill -9 $$", "sbatch refused" } };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        tear_down(NULL);
        assert_int_equal(set_up(NULL), 0);
        add_job("train", 3);
        fake_program("sbatch", bad[i].script);
        assert_int_equal(cn_submit_slurm(&submission), CN_ERR_TOOL);
        assert_non_null(strstr(cn_error_message(), bad[i].message));
        expect_recorded("", "", 0);
    }
}

static void test_no_slurm(void **state)
{
    (void)state;
    add_job("train", 3);
    fake_no_program();
    assert_int_equal(cn_submit_slurm(&submission), CN_ERR_TOOL);
    assert_non_null(strstr(cn_error_message(), "--dry-run"));
    expect_recorded("", "", 0);
}

/* The jobs before a refused one are on record, so that the next submission does not submit them twice. */
static void test_a_refused_job_ends_the_submission(void **state)
{
    (void)state;
    add_job("train", 3);
    add_job("eval", 0);
    add_job("match", 0);
    fake_program("sbatch", "case $* in *eval*) echo 'sbatch: error: limit of jobs'; exit 1;; esac; echo 50");
    assert_int_equal(cn_submit_slurm(&submission), CN_ERR_TOOL);
    assert_non_null(strstr(cn_error_message(), "limit of jobs"));
    expect_recorded("50", "50", 1);
    char *calls = fake_read("calls");
    assert_null(strstr(calls, "match-"));
    free(calls);
}

/* Earlier jobs stay on record, up to a limit. A record that cannot be read is begun anew. */
static void test_record(void **state)
{
    (void)state;
    add_job("train", 3);
    fake_program("sbatch", "echo 60");
    fake_write("old town's/jobs/submission.json", "{\"jobs\": [{\"stage\": \"train\", \"id\": \"59\"}]}");
    assert_int_equal(cn_submit_slurm(&submission), CN_OK);
    expect_recorded("59", "60", 2);
    for (int i = 0; i < 80; i++)
        assert_int_equal(cn_submit_slurm(&submission), CN_OK);
    expect_recorded("60", "60", 65);
    static const char *const damaged[] = { "{\"jobs\": [", "[]", "{\"jobs\": 3}", "" };
    for (size_t i = 0; i < sizeof damaged / sizeof *damaged; i++) {
        fake_write("old town's/jobs/submission.json", damaged[i]);
        assert_int_equal(cn_submit_slurm(&submission), CN_OK);
        expect_recorded("60", "60", 1);
    }
}

static void test_a_dry_run_submits_nothing(void **state)
{
    (void)state;
    options.dry_run = true;
    add_job("train", 3);
    add_job("match", 0);
    fake_program("sbatch", "echo 12");
    assert_int_equal(cn_submit_slurm(&submission), CN_OK);
    char *calls = fake_read("calls");
    assert_string_equal(calls, "");
    free(calls);
    expect_recorded("", "", 0);
    assert_non_null(strstr(fake_log(), "train=$(sbatch --parsable --array=1-3 "));
    assert_non_null(strstr(fake_log(), "--dependency=afterok:$train --kill-on-invalid-dep=yes "));
}

static void test_a_folder_with_a_line_break(void **state)
{
    (void)state;
    free(city.folder);
    city.folder = strdup("/data/a\nb");
    add_job("train", 3);
    fake_program("sbatch", "echo 12");
    assert_int_equal(cn_submit_slurm(&submission), CN_ERR_USAGE);
    char *calls = fake_read("calls");
    assert_string_equal(calls, "");
    free(calls);
}

#define ROW(STAGE, ITEM, WORK, WHERE)                                                                                  \
    {                                                                                                                  \
        .stage = STAGE, .item = ITEM, .work = WORK, .where = WHERE                                                     \
    }

/* Jobs that wait or run count once. 99 is another job than 999. */
static void test_live_jobs(void **state)
{
    (void)state;
    cn_work_row rows[] = { ROW("train", "A1", CN_WORK_QUEUED, "job 999_1 PENDING (Priority)"),
                           ROW("train", "B2", CN_WORK_QUEUED, "job 999_2 PENDING (Priority)"),
                           ROW("train", "C3", CN_WORK_RUNNING, "node1, pid 7, job 99_1"),
                           ROW("train", "D4", CN_WORK_RUNNING, "node1, pid 8"),
                           ROW("train", "E5", CN_WORK_LOST, "job 98_1 RUNNING node1"),
                           ROW("match", "", CN_WORK_QUEUED, "job 9 PENDING (Dependency)") };
    const cn_city_state known = { .rows = rows, .n = sizeof rows / sizeof *rows };
    char train[CN_SUBMIT_LIVE] = "", match[CN_SUBMIT_LIVE] = "";
    cn_submit_find_live(&known, "train", train);
    cn_submit_find_live(&known, "match", match);
    assert_string_equal(train, ":999:99");
    assert_string_equal(match, ":9");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_script, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_task_that_ends, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_what_a_job_submits, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_dependencies, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_more_tasks_than_an_array_has, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_answers, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_no_slurm, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_refused_job_ends_the_submission, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_record, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_dry_run_submits_nothing, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_folder_with_a_line_break, set_up, tear_down),
        cmocka_unit_test(test_live_jobs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
