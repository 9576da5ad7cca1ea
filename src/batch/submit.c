#include "batch/submit.h"

#include "base/clock.h"
#include "base/file.h"
#include "city/lock.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { TASK_S = 7200, MOST_CPUS = 32, PREPARE_CPUS = 4, PREPARE_MINUTES = 24 * 60, PREPARE_MB = 8192 };
enum { TURN_S = 120 }; /* longer than the lock of a machine that failed is held */

/* Enough processors for the longest task to take about two hours. Ask for three times the estimated time (1.2 times a
 * budget, which more processors do not shorten) and 1.25 times the memory: a task that exceeds either is killed. The
 * program itself needs 512 MB. */
static void size_job(cn_submit_job *job, const cn_submit_options *o, const cn_job_node *longest, uint64_t largest)
{
    const double seconds = longest->estimate_s, cpus = fmin(fmax(ceil(seconds / TASK_S), 1), MOST_CPUS);
    job->cpus = o->cpus ? o->cpus : (uint32_t)cpus;
    job->minutes = (uint32_t)ceil((longest->budgeted ? 1.2 * seconds : 3 * seconds / job->cpus) / 60) + 10;
    job->memory_mb = (uint32_t)ceil(1.25 * (double)largest / 1e6) + 512;
}

static bool in_queue(const cn_city_state *state, const char *stage, const char *item)
{
    for (uint32_t i = 0; i < state->n; i++) {
        const cn_work_row *row = &state->rows[i];
        const bool by_item = strcmp(stage, "train") == 0 || strcmp(stage, "group") == 0;
        if (strcmp(row->stage, stage) != 0 || (by_item && strcmp(row->item, item) != 0)) continue;
        return row->work == CN_WORK_QUEUED || (row->work == CN_WORK_RUNNING && strstr(row->where, "job "));
    }
    return false;
}

/* The list is ":12:13"; id is ":12". */
static bool has_id(const char *list, const char *id)
{
    const size_t n = strlen(id);
    for (const char *at = list; (at = strstr(at, id)); at += n)
        if (at[n] == '\0' || at[n] == ':') return true;
    return false;
}

void cn_submit_find_live(const cn_city_state *state, const char *stage, char live[CN_SUBMIT_LIVE])
{
    for (uint32_t i = 0; i < state->n; i++) {
        const cn_work_row *row = &state->rows[i];
        char id[40], colon[48];
        const char *job = strstr(row->where, "job ");
        if (!job || strcmp(row->stage, stage) != 0 || !in_queue(state, stage, row->item)) continue;
        snprintf(id, sizeof id, "%.*s", (int)strspn(job + 4, "0123456789"), job + 4);
        snprintf(colon, sizeof colon, ":%s", id);
        const size_t used = strlen(live);
        if (!has_id(live, colon) && used + strlen(colon) < CN_SUBMIT_LIVE) strcpy(live + used, colon);
    }
}

/* Makes a job of a stage's due nodes that are not in the queue yet. state NULL: take all due nodes. */
static cn_status add_job(cn_submission *s, const char *stage, const cn_city_state *state)
{
    cn_submit_job job = { .stage = stage, .items = calloc(s->graph.n + 1, sizeof *job.items) };
    const cn_job_node *longest = NULL;
    uint64_t largest = 0;
    if (!job.items) return cn_fail(CN_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < s->graph.n; i++) {
        const cn_job_node *node = &s->graph.nodes[i];
        if (node->done || strcmp(node->stage, stage) != 0 || (state && in_queue(state, stage, node->item))) continue;
        if (node->item[0]) job.items[job.n++] = node->item;
        if (!longest || node->estimate_s > longest->estimate_s) longest = node;
        largest = node->estimate_bytes > largest ? node->estimate_bytes : largest;
    }
    if (!longest) {
        free(job.items);
        return CN_OK;
    }
    size_job(&job, s->options, longest, largest);
    s->jobs[s->n_jobs++] = job;
    return CN_OK;
}

/* A single job that makes poses and plan, unless it is in the queue. */
static void add_preparation(cn_submission *s, const cn_city_state *state, const char *stage)
{
    if (in_queue(state, "poses", "") || in_queue(state, "plan", "")) return;
    s->jobs[s->n_jobs++] = (cn_submit_job){ .stage = stage,
                                            .cpus = s->options->cpus ? s->options->cpus : PREPARE_CPUS,
                                            .minutes = PREPARE_MINUTES,
                                            .memory_mb = PREPARE_MB };
}

/* An array of the groups that are due, and the job that merges all. */
static cn_status add_groups(cn_submission *s, const cn_city_state *state)
{
    CN_TRY(add_job(s, "group", state));
    if (s->n_jobs && !s->options->cpus) s->jobs[0].cpus = PREPARE_CPUS;
    cn_submit_find_live(state, "group", s->live);
    add_preparation(s, state, "merge");
    return CN_OK;
}

static cn_status choose_jobs(cn_submission *s, const cn_city_state *state)
{
    bool posed = true, planned = true, grouped = false;
    for (uint32_t i = 0; i < s->graph.n; i++) {
        const cn_job_node *node = &s->graph.nodes[i];
        if (strcmp(node->stage, "poses") == 0) posed = node->done;
        if (strcmp(node->stage, "plan") == 0) planned = node->done;
        grouped = grouped || strcmp(node->stage, "group") == 0;
    }
    if (!posed && grouped) {
        CN_TRY(add_groups(s, state));
    } else if (!posed || !planned) {
        add_preparation(s, state, "prepare");
    } else {
        CN_TRY(add_job(s, "train", state));
        /* When a task of an array fails, Slurm cancels the jobs that wait for the array. Submit them again with the
         * tiles. */
        const cn_city_state *queue = s->n_jobs ? NULL : state;
        cn_submit_find_live(state, "train", s->live);
        cn_submit_find_live(state, "match", s->live_match);
        CN_TRY(add_job(s, "eval", queue));
        const uint32_t before = s->n_jobs;
        CN_TRY(add_job(s, "match", queue));
        CN_TRY(add_job(s, "render", s->n_jobs > before ? NULL : queue));
    }
    for (uint32_t i = 0; i < s->n_jobs; i++)
        CN_TRY(cn_submit_write_list(s, &s->jobs[i]));
    return CN_OK;
}

/* Jobs of earlier submissions may be in a queue that does not answer. */
static cn_status check_queue(const cn_submission *s, const cn_city_state *state)
{
    if (!state->queue[0]) return CN_OK;
    if (!s->options->dry_run)
        return cn_fail(CN_ERR_TOOL,
                       "the queue is not known, and jobs in it would be submitted twice: %s; submit again when squeue "
                       "answers",
                       state->queue);
    cn_log(s->ctx, CN_LOG_WARN, "the queue is not known, and jobs in it are listed once more: %s", state->queue);
    return CN_OK;
}

/* Two submissions at once would not see each other's jobs, in the queue or on record. A submission takes seconds. */
static cn_status take_turn(cn_city_lock *lock, const cn_context *ctx, const cn_city *city)
{
    const double begun = cn_now_s();
    for (;;) {
        const cn_status status = cn_city_lock_take(lock, ctx, city, "jobs", "a submission of the city");
        if (status != CN_ERR_LOCKED || cn_now_s() - begun > TURN_S || cn_stopping(ctx)) return status;
        nanosleep(&(struct timespec){ .tv_nsec = 200000000 }, NULL);
    }
}

static cn_status submit(cn_submission *s, cn_city *city)
{
    const char *quality = s->options->quality;
    static const char *const names[] = { "preview", "standard", "high", "reference", "compact" };
    int q = -1;
    for (int i = 0; quality && i < CN_QUALITIES; i++)
        if (strcmp(names[i], quality) == 0) q = i;
    s->dir = cn_city_path(city, "jobs");
    char *logs = s->dir ? cn_path_join(s->dir, "logs") : NULL;
    cn_status status = logs ? cn_folder_make(logs) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(logs);
    CN_TRY(status);
    CN_TRY(cn_city_graph(s->ctx, city, q, 0, true, &s->graph));
    cn_city_state state;
    CN_TRY(cn_city_state_read(s->ctx, city, &state));
    status = check_queue(s, &state);
    if (status == CN_OK) status = choose_jobs(s, &state);
    cn_city_state_deinit(&state);
    CN_TRY(status);
    if (!s->n_jobs) {
        cn_log(s->ctx, CN_LOG_INFO, "nothing to submit: every stage is done or in the queue");
        return CN_OK;
    }
    return s->options->engine == CN_ENGINE_SLURM ? cn_submit_slurm(s) : cn_submit_kubernetes(s);
}

cn_status cn_city_submit(const cn_context *ctx, cn_city *city, const cn_submit_options *options)
{
    cn_submission s = { .ctx = ctx, .city = city, .options = options };
    cn_city_lock lock = { 0 };
    cn_status status = take_turn(&lock, ctx, city);
    if (status == CN_OK) status = submit(&s, city);
    cn_city_lock_drop(&lock);
    for (uint32_t i = 0; i < s.n_jobs; i++) {
        free(s.jobs[i].items);
        free(s.jobs[i].list);
    }
    cn_job_graph_deinit(&s.graph);
    free(s.dir);
    return status;
}
