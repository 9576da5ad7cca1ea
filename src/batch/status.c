#include "batch/groups.h"
#include "batch/queue.h"

#include "base/file.h"
#include "base/json.h"
#include "base/lock.h"
#include "city/workspace.h"

#include <dirent.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { STUCK_S = 600 };

const char *cn_work_name(cn_work work)
{
    static const char *const names[] = { "waiting", "queued", "running", "stopped", "lost", "failed", "done" };
    return names[work];
}

static bool exists(const cn_city *city, const char *folder, const char *name)
{
    char *path = cn_format("%s/%s/%s", city->folder, folder, name);
    const bool there = path && cn_file_exists(path);
    free(path);
    return there;
}

static json_t *load(const cn_city *city, const char *folder, const char *name)
{
    char *path = cn_format("%s/%s/%s", city->folder, folder, name);
    json_t *root = NULL;
    if (path && cn_file_exists(path) && cn_json_load(path, &root) != CN_OK) root = NULL;
    free(path);
    return root;
}

static double number(const json_t *root, const char *key, double otherwise)
{
    const json_t *value = json_object_get(root, key);
    return json_is_number(value) ? json_number_value(value) : otherwise;
}

/* The last complete line of a log of JSON lines, or NULL. */
static json_t *last_line(const cn_city *city, const char *folder)
{
    char *path = cn_format("%s/%s/log.jsonl", city->folder, folder), text[4097];
    const int fd = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    free(path);
    if (fd < 0) return NULL;
    const off_t size = lseek(fd, 0, SEEK_END);
    const ssize_t n = pread(fd, text, sizeof text - 1, size > 4096 ? size - 4096 : 0);
    close(fd);
    text[n > 0 ? n : 0] = '\0';
    char *end = strrchr(text, '\n');
    if (!end) return NULL;
    *end = '\0';
    const char *begin = strrchr(text, '\n');
    return json_loads(begin ? begin + 1 : text, 0, NULL);
}

/* Running or lost, from the lock file of the process. */
static void read_lock(const cn_city *city, const char *folder, const char *name, cn_work_row *row)
{
    char *path = cn_format("%s/%s/%s", city->folder, folder, name);
    cn_lock_state lock = { 0 };
    if (path) cn_lock_look(path, &lock);
    free(path);
    if (!lock.there) return;
    json_t *note = json_loads(lock.note, 0, NULL);
    row->work = lock.held ? CN_WORK_RUNNING : CN_WORK_LOST;
    row->heartbeat_s = lock.age_s;
    snprintf(row->where, sizeof row->where, "%s, pid %ld", lock.host, lock.pid);
    const char *stage = json_string_value(json_object_get(note, "stage"));
    if (strcmp(row->stage, "train") == 0 && stage && strcmp(stage, row->stage) != 0) {
        /* A tile's photos are read, and matched, before its first step. */
        snprintf(row->note, sizeof row->note, "%s: %.0f of %.0f", stage, number(note, "done", 0),
                 number(note, "total", 0));
    } else {
        row->done = number(note, "done", row->done);
        row->total = number(note, "total", row->total);
        row->left_s = number(note, "left_s", -1);
    }
    row->memory_bytes = number(note, "memory_bytes", 0);
    const double silent = (double)time(NULL) - number(note, "at", (double)time(NULL));
    if (!lock.held)
        snprintf(row->note, sizeof row->note, "its heartbeat stopped %.0f s ago; run the same command to resume",
                 lock.age_s);
    else if (silent > STUCK_S)
        snprintf(row->note, sizeof row->note, "alive, but nothing has moved for %.0f min", silent / 60);
    json_decref(note);
}

static void read_tile(const cn_city *city, cn_work_row *row)
{
    char folder[80];
    snprintf(folder, sizeof folder, "tiles/%s", row->item);
    json_t *log = last_line(city, folder), *metrics = load(city, folder, "metrics.json"),
           *error = load(city, folder, "error.json");
    const bool done = exists(city, folder, "DONE");
    if (done)
        row->work = CN_WORK_DONE;
    else if (exists(city, folder, "checkpoint.safetensors"))
        row->work = CN_WORK_STOPPED;
    const json_t *figures = done && metrics ? metrics : log;
    row->done = number(figures, done ? "steps" : "step", 0);
    row->total = done ? row->done : 0;
    row->psnr = number(figures, done ? "train_psnr" : "psnr", NAN);
    row->samples_per_s = number(figures, "samples_per_s", NAN);
    row->memory_bytes = done ? number(metrics, "arena_bytes", 0) : 0;
    if (error && !done) {
        const char *why = json_string_value(json_object_get(error, "message"));
        row->work = CN_WORK_FAILED;
        snprintf(row->note, sizeof row->note, "%s", why ? why : "");
    }
    read_lock(city, folder, "LOCK", row);
    /* The lock file is touched every few seconds; the log is written more often. */
    if (row->work == CN_WORK_RUNNING && log) {
        row->done = fmax(row->done, number(log, "step", 0));
        row->psnr = number(log, "psnr", NAN);
        row->samples_per_s = number(log, "samples_per_s", NAN);
    }
    json_decref(log);
    json_decref(metrics);
    json_decref(error);
}

static void read_stage(const cn_city *city, const char *folder, const char *made, cn_work_row *row)
{
    if (exists(city, folder, made)) row->work = CN_WORK_DONE;
    read_lock(city, folder, "LOCK", row);
}

/* The default flight: the number of frames with a marker file, and the locks of the processes that render it. */
static cn_status read_frames(const cn_city *city, cn_work_row *row)
{
    char *path = cn_city_path(city, "renders/flight");
    DIR *dir = path ? opendir(path) : NULL;
    uint32_t frames = 0;
    cn_work_row worker = *row;
    cn_status status = path ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the state of %s", city->folder);
    for (const char *name; dir && (status = cn_folder_next(dir, path, &name)) == CN_OK && name;) {
        unsigned frame;
        char rest[8];
        if (sscanf(name, "%5u.%7s", &frame, rest) == 2 && strcmp(rest, "json") == 0) frames++;
        if (strncmp(name, "LOCK", 4) == 0 && worker.work != CN_WORK_RUNNING)
            read_lock(city, "renders/flight", name, &worker);
    }
    if (dir) closedir(dir);
    free(path);
    *row = worker;
    row->done = frames;
    row->total = city->config.render_frames;
    if (row->work == CN_WORK_WAITING && frames) row->work = frames >= row->total ? CN_WORK_DONE : CN_WORK_STOPPED;
    return status;
}

static cn_work_row *add(cn_city_state *state, const char *stage, const char *item)
{
    cn_work_row *larger = realloc(state->rows, (state->n + 1) * sizeof *larger);
    if (!larger) return NULL;
    state->rows = larger;
    cn_work_row *row = &larger[state->n++];
    *row = (cn_work_row){ .psnr = NAN, .samples_per_s = NAN, .left_s = -1, .heartbeat_s = -1 };
    snprintf(row->stage, sizeof row->stage, "%s", stage);
    snprintf(row->item, sizeof row->item, "%s", item);
    return row;
}

/* The groups of photos, where there are any: photos posed, of how many. */
static cn_status read_groups(const cn_city *city, cn_city_state *state)
{
    cn_group_rows groups;
    CN_TRY(cn_group_rows_read(city, &groups));
    bool whole = true;
    for (uint32_t i = 0; i < groups.n && whole; i++) {
        const cn_group_item *group = &groups.items[i];
        char item[16], folder[40];
        snprintf(item, sizeof item, "%u", i + 1);
        snprintf(folder, sizeof folder, "poses/groups/%03u", i + 1);
        cn_work_row *row = add(state, "group", item);
        whole = row != NULL;
        if (!whole) break;
        row->total = group->n_photos;
        row->done = group->n_posed;
        row->work = group->done ? CN_WORK_DONE : group->why[0] ? CN_WORK_FAILED : CN_WORK_WAITING;
        snprintf(row->note, sizeof row->note, "%s", group->why);
        read_lock(city, folder, "LOCK", row);
    }
    cn_group_rows_deinit(&groups);
    return whole ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the state of %s", city->folder);
}

static cn_status read_rows(const cn_city *city, cn_city_state *state)
{
    cn_work_row *row;
    CN_TRY(read_groups(city, state));
    bool whole = (row = add(state, "poses", "")) != NULL;
    if (whole) read_stage(city, "poses", "stage.json", row);
    whole = whole && (row = add(state, "plan", "")) != NULL;
    if (whole) read_stage(city, "plan", "stage.json", row);
    json_t *plan = load(city, "plan", "plan.json");
    const json_t *tiles = json_object_get(plan, "tiles");
    for (size_t i = 0; whole && i < json_array_size(tiles); i++) {
        const char *id = json_string_value(json_object_get(json_array_get(tiles, i), "id"));
        whole = !id || (row = add(state, "train", id)) != NULL;
        if (whole && id) read_tile(city, row);
    }
    if (json_array_size(tiles) > 1 && city->config.match) {
        whole = whole && (row = add(state, "match", "")) != NULL;
        if (whole) read_stage(city, "match", "mean.json", row);
    }
    json_decref(plan);
    whole = whole && (row = add(state, "eval", "")) != NULL;
    if (whole) read_stage(city, "eval", "stage.json", row);
    whole = whole && (row = add(state, "render", "")) != NULL;
    return whole ? read_frames(city, row) : cn_fail(CN_ERR_NOMEM, "out of memory for the state of %s", city->folder);
}

cn_status cn_city_state_read(const cn_context *ctx, cn_city *city, cn_city_state *state)
{
    *state = (cn_city_state){ .left_s = -1 };
    const cn_status status = read_rows(city, state);
    if (status != CN_OK) {
        cn_city_state_deinit(state);
        return status;
    }
    cn_queue_join(ctx, city, state);
    for (uint32_t i = 0; i < state->n; i++) {
        const cn_work_row *row = &state->rows[i];
        if (row->work == CN_WORK_RUNNING) state->left_s = fmax(state->left_s, row->left_s);
        if (strcmp(row->stage, "train") != 0) continue;
        state->n_tiles++;
        state->tiles[row->work]++;
    }
    return CN_OK;
}

void cn_city_state_deinit(cn_city_state *state)
{
    free(state->rows);
    *state = (cn_city_state){ 0 };
}

static json_t *row_json(const cn_work_row *r)
{
    json_t *root = json_pack("{s:s,s:s,s:s,s:f,s:f,s:o,s:o,s:f,s:s,s:s}", "stage", r->stage, "item", r->item, "state",
                             cn_work_name(r->work), "done", r->done, "total", r->total, "psnr", cn_json_real(r->psnr),
                             "samples_per_s", cn_json_real(r->samples_per_s), "memory_bytes", r->memory_bytes, "where",
                             r->where, "note", r->note);
    if (root && r->left_s >= 0) json_object_set_new(root, "left_s", json_real(r->left_s));
    if (root && r->heartbeat_s >= 0) json_object_set_new(root, "heartbeat_s", json_real(r->heartbeat_s));
    return root;
}

cn_status cn_city_state_json(const cn_city_state *state, char **json)
{
    json_t *root = json_object(), *tiles = json_object(), *rows = json_array();
    for (int w = 0; w <= CN_WORK_DONE; w++)
        json_object_set_new(tiles, cn_work_name((cn_work)w), json_integer(state->tiles[w]));
    for (uint32_t i = 0; i < state->n; i++)
        json_array_append_new(rows, row_json(&state->rows[i]));
    json_object_set_new(root, "tiles", tiles);
    json_object_set_new(root, "rows", rows);
    json_object_set_new(root, "queue", json_string(state->queue));
    *json = root ? json_dumps(root, JSON_COMPACT | JSON_REAL_PRECISION(9)) : NULL;
    json_decref(root);
    return *json ? CN_OK : cn_fail(CN_ERR_NOMEM, "out of memory for the state as JSON");
}
