#include "batch/queue.h"
#include "batch/submit.h"

#include "base/file.h"
#include "base/json.h"
#include "base/process.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const char cn_slurm_template[];

enum { KEPT_JOBS = 64 };

/* The path CITY/jobs/STAGE-HASH.sbatch, in the folder of its list of items; the caller frees it. */
static cn_status write_script(const cn_submission *s, const cn_submit_job *job, char **script)
{
    const cn_submit_options *o = s->options;
    char cpus[16], minutes[16], memory[16];
    snprintf(cpus, sizeof cpus, "%u", job->cpus);
    snprintf(minutes, sizeof minutes, "%u", job->minutes);
    snprintf(memory, sizeof memory, "%u", job->memory_mb);
    char *city = cn_shell_word(s->city->folder), *program = cn_shell_word(o->program),
         *items = cn_shell_word(job->list);
    char *folder = cn_path_join(s->dir, "logs"), *logs = folder ? cn_sbatch_word(folder, true) : NULL;
    char *title = cn_format("%s-%s", cn_path_base(s->city->folder), job->stage);
    char *name = title ? cn_sbatch_word(title, false) : NULL, *text = NULL;
    char *quality = o->quality ? cn_format("--quality %s", o->quality) : cn_format("%s", "");
    char *template_dir = o->template_dir ? cn_shell_word(o->template_dir) : NULL;
    char *options =
        cn_format("%s%s%s --max-tasks %u --cpus %u", quality ? quality : "", template_dir ? " --template " : "",
                  template_dir ? template_dir : "", o->max_tasks, o->cpus);
    *script = cn_format("%.*s.sbatch", (int)(strlen(job->list) - strlen(".items")), job->list);
    cn_status status = cn_fail(CN_ERR_NOMEM, "out of memory for a script");
    if (city && program && items && logs && name && quality && options && *script) {
        const cn_blank blanks[] = { { "name", name },
                                    { "stage", job->stage },
                                    { "logs", logs },
                                    { "cpus", cpus },
                                    { "minutes", minutes },
                                    { "memory_mb", memory },
                                    { "conurb", program },
                                    { "city", city },
                                    { "items", items },
                                    { "options", options },
                                    { "train_options", quality },
                                    { NULL, NULL } };
        status = cn_template_fill(o->template_dir, "slurm.sbatch", cn_slurm_template, blanks, &text);
    }
    if (status == CN_OK) status = cn_file_write(*script, text, strlen(text));
    char *owned[] = { city, program, items, folder, logs, title, name, quality, options, template_dir, text };
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++)
        free(owned[i]);
    return status;
}

/* Reads sbatch's output: the job's id, or the reason of a refusal. */
typedef struct answer {
    char id[32];
    char text[512];
} answer;

static void read_answer(void *user, char *line)
{
    answer *a = user;
    const size_t n = strspn(line, "0123456789");
    /* --parsable: "12" or "12;cluster". */
    if (n && n < sizeof a->id && (line[n] == '\0' || line[n] == ';'))
        snprintf(a->id, sizeof a->id, "%.*s", (int)n, line);
    else
        snprintf(a->text, sizeof a->text, "%s", line);
}

static cn_status hand_over(const cn_submission *s, const cn_submit_job *job, const char *array, const char *after,
                           const char *script, answer *a)
{
    const char *argv[8] = { "sbatch", "--parsable" };
    int n = 2, code = 0;
    if (*array) argv[n++] = array;
    if (*after) argv[n++] = after, argv[n++] = "--kill-on-invalid-dep=yes";
    argv[n++] = script;
    argv[n] = NULL;
    *a = (answer){ 0 };
    const cn_status status = cn_process_run(s->ctx, argv, "/dev/null", read_answer, a, &code);
    if (status == CN_ERR_TOOL)
        return cn_fail(
            CN_ERR_TOOL,
            "sbatch cannot be run: this machine has no Slurm; submit from one that has it, or use --dry-run");
    CN_TRY(status);
    if (code != 0 || !a->id[0])
        return cn_fail(CN_ERR_TOOL, "sbatch refused %s: %s", script, a->text[0] ? a->text : "it said nothing");
    cn_log(s->ctx, CN_LOG_INFO, "%s: job %s%s%s", job->stage, a->id, *array ? ", " : "", *array ? array + 2 : "");
    return CN_OK;
}

/* Earlier submissions stay on record, because some of their jobs may be in the queue. */
static json_t *record_so_far(const char *path)
{
    json_t *root = NULL;
    if (cn_file_exists(path) && cn_json_load(path, &root) != CN_OK) root = NULL;
    if (!json_is_object(root)) {
        json_decref(root);
        root = json_object();
    }
    if (!json_is_array(json_object_get(root, "jobs"))) json_object_set_new(root, "jobs", json_array());
    json_object_set_new(root, "engine", json_string("slurm"));
    json_t *jobs = json_object_get(root, "jobs");
    while (json_array_size(jobs) > KEPT_JOBS)
        json_array_remove(jobs, 0);
    return root;
}

static void record_job(json_t *root, const cn_submit_job *job, const char *id, const char *script)
{
    json_t *items = json_array();
    for (uint32_t i = 0; i < job->n; i++)
        json_array_append_new(items, json_string(job->items[i]));
    json_array_append_new(json_object_get(root, "jobs"), json_pack("{s:s,s:s,s:o,s:s}", "stage", job->stage, "id", id,
                                                                   "items", items, "script", script));
}

static bool is(const cn_submit_job *job, const char *stage)
{
    return strcmp(job->stage, stage) == 0;
}

/* Ids of this submission's jobs, as ":12"; "" when there is none. */
typedef struct parent_ids {
    char group[32], train[32], match[32];
} parent_ids;

/* Match and eval wait for the tiles of this submission and for those still running from earlier ones; renders also
 * wait for the match. The merge waits for the groups, also for those that fail. */
static void dependency(const cn_submission *s, const cn_submit_job *job, const parent_ids *p, char *out, size_t size)
{
    const bool first = is(job, "train") || is(job, "prepare") || is(job, "group"), last = is(job, "render");
    char jobs[1200];
    snprintf(jobs, sizeof jobs, "%s%s%s%s%s", p->group, p->train, s->live, last ? p->match : "",
             last ? s->live_match : "");
    out[0] = '\0';
    if (!first && jobs[0]) snprintf(out, size, "--dependency=%s%s", is(job, "merge") ? "afterany" : "afterok", jobs);
}

static void print_command(const cn_submission *s, const cn_submit_job *job, const char *array, const char *after,
                          const char *script)
{
    char *word = cn_shell_word(script);
    cn_log(s->ctx, CN_LOG_INFO, "%s=$(sbatch --parsable %s%s%s%s%s)", job->stage, array, *array ? " " : "", after,
           *after ? " --kill-on-invalid-dep=yes " : "", word ? word : script);
    free(word);
}

cn_status cn_submit_slurm(cn_submission *s)
{
    if (strchr(s->city->folder, '\n'))
        return cn_fail(CN_ERR_USAGE, "%s: a script for Slurm cannot name a folder with a line break; rename it",
                       s->city->folder);
    char *path = cn_city_path(s->city, CN_SUBMISSION);
    json_t *record = path ? record_so_far(path) : NULL;
    cn_status status = record ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    parent_ids parents = { "", "", "" };
    for (uint32_t i = 0; i < s->n_jobs && status == CN_OK; i++) {
        const cn_submit_job *job = &s->jobs[i];
        char *script = NULL, array[64] = "", limit[32] = "", after[1280];
        answer a;
        if (s->options->max_tasks) snprintf(limit, sizeof limit, "%%%u", s->options->max_tasks);
        if (job->n) snprintf(array, sizeof array, "--array=1-%u%s", job->n, limit);
        status = write_script(s, job, &script);
        dependency(s, job, &parents, after, sizeof after);
        snprintf(a.id, sizeof a.id, "$%s", job->stage);
        if (status == CN_OK && s->options->dry_run) {
            print_command(s, job, array, after, script);
        } else if (status == CN_OK) {
            status = hand_over(s, job, array, after, script, &a);
            if (status == CN_OK) record_job(record, job, a.id, script);
            /* Save after each job, so that the record is right even when the next job is refused. */
            if (status == CN_OK) status = cn_json_save(record, path);
        }
        if (is(job, "group")) snprintf(parents.group, sizeof parents.group, ":%.30s", a.id);
        if (is(job, "train")) snprintf(parents.train, sizeof parents.train, ":%.30s", a.id);
        if (is(job, "match")) snprintf(parents.match, sizeof parents.match, ":%.30s", a.id);
        free(script);
    }
    json_decref(record);
    free(path);
    return status;
}
