/* What is handed to Kubernetes: Jobs whose input is there, under names of their own. kubectl is a script. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "base/file.h"
#include "batch/submit.h"
#include "fake.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { NODES = 5, MOST_PODS = 100000, LABEL = 63 };
static cn_job_node nodes[NODES];
static cn_city city;
static cn_submit_options options;
static cn_submission submission;

static int set_up(void **state)
{
    (void)state;
    memset(nodes, 0, sizeof nodes);
    options = (cn_submit_options){ 0 };
    fake_submission_begin(&submission, &city, &options, "town");
    submission.graph = (cn_job_graph){ .nodes = nodes };
    fake_program("kubectl", "true");
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    fake_submission_end(&submission, &city);
    return 0;
}

static cn_job_node *add_node(const char *stage)
{
    cn_job_node *node = &nodes[submission.graph.n++];
    snprintf(node->stage, sizeof node->stage, "%s", stage);
    return node;
}

static void add_job(const char *stage)
{
    cn_submit_job *job = &submission.jobs[submission.n_jobs++];
    *job = (cn_submit_job){ .stage = stage, .n = MOST_PODS, .cpus = 4, .minutes = 50, .memory_mb = 2048 };
    job->list = cn_format("%s/%s-0123abcd.items", submission.dir, stage);
}

/* Submits, and whether these stages are in the manifest, and no others. The caller frees the manifest. */
static char *submit(const char *const *stages)
{
    fake_write("town/jobs/kubernetes.yaml", "");
    assert_int_equal(cn_submit_kubernetes(&submission), CN_OK);
    char *manifest = fake_read("town/jobs/kubernetes.yaml");
    for (uint32_t i = 0; i < submission.n_jobs; i++) {
        const char *stage = submission.jobs[i].stage;
        char label[64];
        bool wanted = false;
        for (const char *const *s = stages; *s; s++)
            wanted = wanted || strcmp(*s, stage) == 0;
        snprintf(label, sizeof label, "labels: {app: conurb, stage: %s}\nspec:", stage);
        if ((strstr(manifest, label) != NULL) != wanted) fail_msg("%s: %s", stage, wanted ? "missing" : "too early");
    }
    return manifest;
}

/* A Job whose input is missing would hold what the others need. */
static void test_only_what_can_begin(void **state)
{
    (void)state;
    cn_job_node *tile = add_node("train"), *match = add_node("match");
    add_node("eval");
    add_node("render");
    add_job("train");
    add_job("eval");
    add_job("match");
    add_job("render");
    free(submit((const char *const[]){ "train", NULL }));
    assert_non_null(strstr(fake_log(), "submit again when what is submitted has ended"));
    tile->done = true;
    submission.jobs[0].stage = "none";
    free(submit((const char *const[]){ "none", "eval", "match", NULL }));
    match->done = true;
    free(submit((const char *const[]){ "none", "eval", "match", "render", NULL }));
}

/* The merge follows when no group is left but those that failed. */
static void test_groups(void **state)
{
    (void)state;
    cn_job_node *group = add_node("group"), *failed = add_node("group");
    failed->failed = true;
    add_node("plan");
    add_job("group");
    add_job("merge");
    free(submit((const char *const[]){ "group", NULL }));
    group->done = true;
    free(submit((const char *const[]){ "merge", NULL }));
    char *calls = fake_read("calls");
    assert_non_null(strstr(calls, "apply\n-f\n"));
    free(calls);
}

static void name_of(const char *folder, char name[80])
{
    free(city.folder);
    city.folder = cn_format("%s/%s", fake_dir(), folder);
    char *manifest = submit((const char *const[]){ "prepare", NULL }), *at = strstr(manifest, "  name: ");
    assert_non_null(at);
    assert_int_equal(sscanf(at, "  name: %79s", name), 1);
    free(manifest);
}

/* A Job that failed keeps its name, and letters that a name cannot have are left out of it. The name of a pod has a
 * number behind the Job's, and has to be a label. */
static void test_names(void **state)
{
    (void)state;
    char first[80], again[80], other[80], name[80], pod[96];
    add_job("prepare");
    name_of("Zürich", first);
    name_of("Zürich", again);
    name_of("Zärich", other);
    assert_string_not_equal(first, again);
    assert_string_not_equal(first, other);
    assert_memory_equal(first, "conurb-z--rich-prepare-", strlen("conurb-z--rich-prepare-"));
    name_of("a-town-whose-name-is-longer-than-any-label-of-kubernetes-may-be-at-all", name);
    snprintf(pod, sizeof pod, "%s-%d", name, MOST_PODS - 1);
    assert_true(strlen(pod) <= LABEL);
    assert_int_equal(strspn(name, "abcdefghijklmnopqrstuvwxyz0123456789-"), strlen(name));
}

/* The program of the image runs the tasks, or another one; a device that is asked for goes with them. */
static void test_commands(void **state)
{
    (void)state;
    add_node("train");
    add_job("train");
    char *manifest = submit((const char *const[]){ "train", NULL });
    assert_non_null(strstr(manifest, "exec conurb train '"));
    assert_non_null(strstr(manifest, "items')\\\" --threads 4\"]"));
    free(manifest);
    options = (cn_submit_options){ .program = "/opt/conurb", .device = "gpu", .quality = "high" };
    manifest = submit((const char *const[]){ "train", NULL });
    assert_non_null(strstr(manifest, "exec '/opt/conurb' train '"));
    assert_non_null(strstr(manifest, "items')\\\" --threads 4 --device 'gpu' --quality high\"]"));
    free(manifest);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_only_what_can_begin, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_groups, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_commands, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_names, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
