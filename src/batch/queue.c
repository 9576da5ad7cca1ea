#include "batch/queue.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/json.h"
#include "base/process.h"
#include "city/workspace.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct asker {
    const json_t *jobs;
    cn_city_state *state;
    char said[160]; /* the last line that is no job: an error */
} asker;

static cn_work_row *find_row(cn_city_state *state, const char *stage, const char *item)
{
    for (uint32_t i = 0; i < state->n; i++)
        if (strcmp(state->rows[i].stage, stage) == 0 && (!*item || strcmp(state->rows[i].item, item) == 0))
            return &state->rows[i];
    return NULL;
}

/* The row of a job's item. The jobs "prepare" and "merge" make the poses, then the plan. Where there are groups,
 * "prepare" is over: it split the photos, and "merge" follows. All chunks of frames share one row. */
static cn_work_row *row_of(cn_city_state *state, const char *stage, const char *item)
{
    const bool prepare = strcmp(stage, "prepare") == 0;
    if (prepare && find_row(state, "group", "")) return NULL;
    if (prepare || strcmp(stage, "merge") == 0) {
        cn_work_row *poses = find_row(state, "poses", "");
        return poses && poses->work == CN_WORK_DONE ? find_row(state, "plan", "") : poses;
    }
    return find_row(state, stage, strcmp(stage, "render") == 0 ? "" : item);
}

static void tell(cn_work_row *row, const char *job, const char *queue, const char *node, const char *why)
{
    const bool pending =
        strcmp(queue, "PENDING") == 0 || strcmp(queue, "REQUEUED") == 0 || strcmp(queue, "SUSPENDED") == 0;
    if (row->work == CN_WORK_DONE) return;
    if (row->work == CN_WORK_RUNNING) {
        snprintf(row->where + strlen(row->where), sizeof row->where - strlen(row->where), ", job %s", job);
        return;
    }
    /* The heartbeat shows sooner than the queue that a task is dead. */
    if (row->work == CN_WORK_LOST && !pending)
        snprintf(row->note, sizeof row->note, "the queue still says %s", queue);
    else
        row->work = CN_WORK_QUEUED;
    snprintf(row->where, sizeof row->where, "job %s %s %s", job, queue, pending ? why : node);
}

/* "12_3|RUNNING|node1|None" or "13|PENDING||(Dependency)". */
static void read_line(void *user, char *line)
{
    asker *a = user;
    if (!strchr(line, '|')) snprintf(a->said, sizeof a->said, "%s", line);
    char *field[4] = { line, NULL, NULL, NULL };
    for (int i = 1; i < 4; i++) {
        field[i] = field[i - 1] ? strchr(field[i - 1], '|') : NULL;
        if (!field[i]) return;
        *field[i]++ = '\0';
    }
    const size_t id = strcspn(line, "_");
    const long task = line[id] ? strtol(line + id + 1, NULL, 10) : 0;
    for (size_t j = 0; j < json_array_size(a->jobs); j++) {
        const json_t *job = json_array_get(a->jobs, j);
        const char *name = json_string_value(json_object_get(job, "id")),
                   *stage = json_string_value(json_object_get(job, "stage"));
        if (!name || !stage || strlen(name) != id || strncmp(name, line, id) != 0) continue;
        const char *item =
            task > 0 ? json_string_value(json_array_get(json_object_get(job, "items"), (size_t)task - 1)) : "";
        cn_work_row *row = item ? row_of(a->state, stage, item) : NULL;
        if (row) tell(row, line, field[1], field[2], field[3]);
    }
}

static char *id_list(const json_t *jobs)
{
    char *list = calloc(1, 32 * json_array_size(jobs) + 1);
    for (size_t j = 0; list && j < json_array_size(jobs); j++) {
        const char *id = json_string_value(json_object_get(json_array_get(jobs, j), "id"));
        if (id && strlen(id) < 31) strcat(strcat(list, *list ? "," : ""), id);
    }
    return list;
}

/* Many machines have no Slurm, and need no warning. When all jobs have left the queue long ago, their numbers are
 * invalid.
 */
static void ask_squeue(const cn_context *ctx, asker *a, const char *ids)
{
    const char *const argv[] = { "squeue", "--noheader", "--array", "--jobs", ids, "--format", "%i|%T|%N|%r", NULL };
    const cn_process squeue = {
        .argv = argv, .log_path = "/dev/null", .on_line = read_line, .user = a, .limit_s = CN_SLURM_LIMIT_S
    };
    const double begun = cn_now_s();
    int code = 0;
    const cn_status status = cn_process_watch(ctx, &squeue, &code);
    char *why = a->state->queue;
    if (status == CN_ERR_TOOL && cn_now_s() - begun < squeue.limit_s)
        cn_log(ctx, CN_LOG_DEBUG, "the queue is not known: %s", cn_error_message());
    else if (status != CN_OK)
        snprintf(why, sizeof a->state->queue, "%s", cn_error_message());
    else if (code != 0 && !strstr(a->said, "Invalid job id"))
        snprintf(why, sizeof a->state->queue, "squeue ended with %d: %s", code, a->said);
}

void cn_queue_join(const cn_context *ctx, const cn_city *city, cn_city_state *state)
{
    char *path = cn_city_path(city, CN_SUBMISSION);
    json_t *root = NULL;
    const bool read = path && cn_file_exists(path) && cn_json_load(path, &root) == CN_OK;
    const char *engine = json_string_value(json_object_get(root, "engine"));
    asker a = { .jobs = json_object_get(root, "jobs"), .state = state };
    if (read && engine && strcmp(engine, "slurm") == 0 && json_array_size(a.jobs)) {
        char *ids = id_list(a.jobs);
        if (ids)
            ask_squeue(ctx, &a, ids);
        else
            snprintf(state->queue, sizeof state->queue, "out of memory");
        free(ids);
    }
    json_decref(root);
    free(path);
}
