#include "batch/queue.h"
#include "batch/submit.h"

#include "base/file.h"
#include "base/json.h"
#include "base/process.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const char cn_slurm_template[];

/* Slurm takes no index of an array from its MaxArraySize on, by default 1001. */
enum { KEPT_JOBS = 64, MOST_TASKS = 1000 };

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
    char *device = cn_submit_device_option(o);
    char *options = cn_format("%s%s%s --max-tasks %u --cpus %u --program %s%s", quality ? quality : "",
                              template_dir ? " --template " : "", template_dir ? template_dir : "", o->max_tasks,
                              o->cpus, program ? program : "", device ? device : "");
    *script = cn_format("%.*s.sbatch", (int)(strlen(job->list) - strlen(".items")), job->list);
    cn_status status = cn_fail(CN_ERR_NOMEM, "out of memory for a script");
    if (city && program && items && logs && name && quality && device && options && *script) {
        const cn_blank blanks[] = { { "name", name },
                                    { "stage", job->stage },
                                    { "logs", logs },
                                    { "job", job->n ? "%A_%a" : "%j" },
                                    { "cpus", cpus },
                                    { "minutes", minutes },
                                    { "memory_mb", memory },
                                    { "conurb", program },
                                    { "city", city },
                                    { "items", items },
                                    { "options", options },
                                    { "train_options", quality },
                                    { "device_option", device },
                                    { NULL, NULL } };
        status = cn_template_fill(o->template_dir, "slurm.sbatch", cn_slurm_template, blanks, &text);
    }
    if (status == CN_OK) status = cn_file_write(*script, text, strlen(text));
    char *owned[] = { city, program, items, folder, logs, title, name, quality, device, options, template_dir, text };
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

/* What one submission has handed over so far. Ids are lists as ":12:13"; NULL when there is none. */
typedef struct handed {
    const cn_submission *s;
    json_t *record;
    const char *path; /* of the record */
    char *group, *train, *match;
} handed;

static cn_status add_id(char **list, const char *id)
{
    char *longer = cn_format("%s:%s", *list ? *list : "", id);
    if (!longer) return cn_fail(CN_ERR_NOMEM, "out of memory");
    free(*list);
    *list = longer;
    return CN_OK;
}

static cn_status note_id(handed *h, const cn_submit_job *job, const char *id)
{
    if (is(job, "group")) return add_id(&h->group, id);
    if (is(job, "train")) return add_id(&h->train, id);
    return is(job, "match") ? add_id(&h->match, id) : CN_OK;
}

static const char *text_of(const char *list)
{
    return list ? list : "";
}

/* Match and eval wait for the tiles of this submission and for those still running from earlier ones; renders also
 * wait for the match. The merge waits for the groups, also for those that fail. before: the part of the same stage that
 * ends first, or "". The caller frees the option; "": the job waits for nothing; NULL: out of memory. */
static char *dependency(const handed *h, const cn_submit_job *job, const char *before)
{
    const cn_submission *s = h->s;
    const bool first = is(job, "train") || is(job, "prepare") || is(job, "group"), last = is(job, "render");
    char *jobs = cn_format("%s%s%s%s%s", text_of(h->group), text_of(h->train), s->live, last ? text_of(h->match) : "",
                           last ? s->live_match : "");
    if (!jobs) return NULL;
    const bool waits = !first && *jobs;
    char *option = cn_format("%s%s%s%s%s%s", waits || *before ? "--dependency=" : "",
                             !waits             ? ""
                             : is(job, "merge") ? "afterany"
                                                : "afterok",
                             waits ? jobs : "", waits && *before ? "," : "", *before ? "afterany:" : "", before);
    free(jobs);
    return option;
}

/* id: as "$train", a variable in place of the answer. */
static void print_command(const cn_submission *s, const char *id, const char *array, const char *after,
                          const char *script)
{
    char *word = cn_shell_word(script);
    cn_log(s->ctx, CN_LOG_INFO, "%s=$(sbatch --parsable %s%s%s%s%s)", id + 1, array, *array ? " " : "", after,
           *after ? " --kill-on-invalid-dep=yes " : "", word ? word : script);
    free(word);
}

/* Hands over a job, or part `number` of one. id: of the part that ends first, or ""; then its own. */
static cn_status submit_part(handed *h, const cn_submit_job *job, uint32_t number, char id[32])
{
    const cn_submission *s = h->s;
    char *script = NULL, array[64] = "", limit[32] = "";
    answer a = { 0 };
    if (s->options->max_tasks) snprintf(limit, sizeof limit, "%%%u", s->options->max_tasks);
    if (job->n) snprintf(array, sizeof array, "--array=1-%u%s", job->n, limit);
    char *after = dependency(h, job, id);
    cn_status status = after ? write_script(s, job, &script) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (number == 1)
        snprintf(a.id, sizeof a.id, "$%s", job->stage);
    else
        snprintf(a.id, sizeof a.id, "$%s_%u", job->stage, number);
    if (status == CN_OK && s->options->dry_run) {
        print_command(s, a.id, array, after, script);
    } else if (status == CN_OK) {
        status = hand_over(s, job, array, after, script, &a);
        if (status == CN_OK) record_job(h->record, job, a.id, script);
        /* Save after each job, so that the record is right even when the next job is refused. */
        if (status == CN_OK) status = cn_json_save(h->record, h->path);
    }
    if (status == CN_OK) status = note_id(h, job, a.id);
    snprintf(id, sizeof a.id, "%s", a.id);
    free(after);
    free(script);
    return status;
}

/* More tasks than Slurm takes in an array are several arrays, one after the other where the tasks at once are limited:
 * the limit is of each array. */
static cn_status submit_job(handed *h, const cn_submit_job *job)
{
    char id[32] = "";
    if (job->n <= MOST_TASKS) return submit_part(h, job, 1, id);
    cn_status status = CN_OK;
    for (uint32_t begin = 0, number = 1; begin < job->n && status == CN_OK; begin += MOST_TASKS, number++) {
        cn_submit_job part = *job;
        part.items = job->items + begin;
        part.n = job->n - begin < MOST_TASKS ? job->n - begin : MOST_TASKS;
        part.list = NULL;
        if (!h->s->options->max_tasks) id[0] = '\0';
        status = cn_submit_write_list(h->s, &part);
        if (status == CN_OK) status = submit_part(h, &part, number, id);
        free(part.list);
    }
    return status;
}

/* The most that a node of the cluster has. 0: not known. */
typedef struct largest_node {
    unsigned long cpus, memory_mb;
} largest_node;

/* A line is "64 257000", or "64+ 257000+" where nodes differ; the larger ones are not known then. */
static void read_node(void *user, char *line)
{
    largest_node *most = user;
    char *rest = NULL;
    const unsigned long cpus = strtoul(line, &rest, 10), memory_mb = strtoul(rest + (*rest == '+'), NULL, 10);
    if (cpus > most->cpus) most->cpus = cpus;
    if (memory_mb > most->memory_mb) most->memory_mb = memory_mb;
}

/* A job that asks for more processors than any node has waits for ever, and Slurm says nothing. So jobs ask for no more
 * than the largest node has, unless the user says how many. What poses need is a guess: it stays as long, and has no
 * more memory than a node either. */
static cn_status fit_to_nodes(cn_submission *s)
{
    static const char *const argv[] = { "sinfo", "--noheader", "--Node", "--format=%c %m", NULL };
    largest_node most = { 0 };
    int code = 0;
    const cn_status status = cn_process_run(s->ctx, argv, "/dev/null", read_node, &most, &code);
    if (status == CN_ERR_INTERRUPTED) return status;
    for (uint32_t i = 0; status == CN_OK && code == 0 && i < s->n_jobs; i++) {
        cn_submit_job *job = &s->jobs[i];
        const bool guess = is(job, "prepare") || is(job, "merge");
        if (most.cpus && !s->options->cpus && job->cpus > most.cpus) {
            if (!guess) job->minutes = (uint32_t)((uint64_t)job->minutes * job->cpus / most.cpus);
            job->cpus = (uint32_t)most.cpus;
        }
        if (guess && most.memory_mb && job->memory_mb > most.memory_mb) job->memory_mb = (uint32_t)most.memory_mb;
    }
    return CN_OK;
}

cn_status cn_submit_slurm(cn_submission *s)
{
    if (strchr(s->city->folder, '\n'))
        return cn_fail(CN_ERR_USAGE, "%s: a script for Slurm cannot name a folder with a line break; rename it",
                       s->city->folder);
    CN_TRY(fit_to_nodes(s));
    char *path = cn_city_path(s->city, CN_SUBMISSION);
    handed h = { .s = s, .record = path ? record_so_far(path) : NULL, .path = path };
    cn_status status = h.record ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < s->n_jobs && status == CN_OK; i++)
        status = submit_job(&h, &s->jobs[i]);
    char *owned[] = { h.group, h.train, h.match, path };
    for (size_t i = 0; i < sizeof owned / sizeof *owned; i++)
        free(owned[i]);
    json_decref(h.record);
    return status;
}
