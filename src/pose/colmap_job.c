/* Runs COLMAP, tells its progress, and marks what is done. */
#include "pose/colmap_job.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/hash.h"
#include "base/json.h"
#include "base/process.h"
#include "pose/colmap_options.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MARKER_VERSION 1
#define SILENCE_S 2 /* at most, between two reports of progress */

static void report(cn_colmap_job *j, double now)
{
    /* When a step takes longer than expected, the time left is unknown. */
    const double left = j->left_s - (now - j->advanced_s);
    const cn_progress_report report = { "poses",  j->stage,           j->done,
                                        j->total, now - j->started_s, left >= 0.0 ? left : -1.0,
                                        NULL };
    j->told_s = now;
    cn_progress(j->ctx, &report);
}

/* Predict from the last steps only: a resumed run skips the first ones quickly. */
void cn_job_tell(cn_colmap_job *j, double done)
{
    const double now = cn_now_s(), more = done - j->done;
    if (more > 0.0) {
        const double step_s = (now - j->advanced_s) / more;
        j->step_s = j->step_s > 0.0 ? 0.7 * j->step_s + 0.3 * step_s : step_s;
        j->advanced_s = now;
    }
    j->done = done;
    j->left_s = j->total >= done && j->step_s > 0.0 ? j->step_s * (j->total - done) : -1.0;
    report(j, now);
}

static void on_wait(void *user)
{
    cn_colmap_job *j = user;
    const double now = cn_now_s();
    if (now - j->told_s >= SILENCE_S) report(j, now);
}

static void on_feature_line(cn_colmap_job *j, const char *line)
{
    unsigned done, total;
    if (sscanf(line, "Processed file [%u/%u]", &done, &total) == 2) {
        cn_job_tell(j, j->base + done);
        if (done == total) j->base += total;
    } else if (sscanf(line, " Name: %255[^\n]", j->photo) != 1 && strstr(line, "ERROR:")) {
        const unsigned long number = j->linked ? strtoul(j->photo, NULL, 10) : j->index->n_photos;
        cn_log(j->ctx, CN_LOG_WARN, "COLMAP cannot read photo %s: %s",
               number < j->index->n_photos ? j->index->photos[number].name : j->photo, strstr(line, "ERROR:") + 7);
    }
}

static void on_line(void *user, char *line)
{
    cn_colmap_job *j = user;
    unsigned a, b, c, d;
    bool is_error = strstr(line, "ERROR") != NULL || strstr(line, "what():") != NULL;
    if (is_error || !j->error_seen) snprintf(j->last, sizeof j->last, "%s", line + strspn(line, " "));
    j->error_seen = j->error_seen || is_error;
    if (strcmp(j->stage, "features") == 0) {
        on_feature_line(j, line);
    } else if (sscanf(line, "Matching block [%u/%u, %u/%u]", &a, &b, &c, &d) == 4) {
        if (a && b && d) cn_job_tell(j, j->base + j->part * ((double)(a - 1) * d + c) / ((double)b * d));
    } else if (sscanf(line, "Matching block [%u/%u]", &a, &b) == 2) {
        if (b) cn_job_tell(j, j->base + j->part * a / b);
    } else if (sscanf(line, "Registering image #%u (%u)", &a, &b) == 2) {
        cn_job_tell(j, b);
    }
}

cn_status cn_job_run(cn_colmap_job *j, const char *const *argv, int *exit_code)
{
    const char *words[CN_JOB_WORDS];
    CN_TRY(cn_colmap_rename(j->ctx, argv, words));
    j->last[0] = '\0';
    j->error_seen = false;
    const cn_process process = {
        .argv = words, .log_path = j->log, .note_path = j->note, .on_line = on_line, .on_wait = on_wait, .user = j
    };
    cn_status status = cn_process_watch(j->ctx, &process, exit_code);
    if (status == CN_ERR_TOOL)
        return cn_fail(CN_ERR_TOOL,
                       "cannot run %s, which finds the poses: install the package colmap (apt-get install "
                       "colmap), or set poses.import to a COLMAP model or transforms.json",
                       argv[0]);
    return status;
}

cn_status cn_job_failed(const cn_colmap_job *j, int exit_code)
{
    if (exit_code > 128)
        return cn_fail(CN_ERR_TOOL, "COLMAP was killed by signal %d at %s%s; see %s", exit_code - 128, j->stage,
                       exit_code == 137 ? " (out of memory? lower poses.max_image_px or the threads)" : "", j->log);
    return cn_fail(CN_ERR_TOOL, "COLMAP failed at %s: %s (exit code %d); see %s", j->stage, j->last, exit_code, j->log);
}

/* Marker files: the hash of the inputs for which a stage was begun or finished. */
char *cn_job_marker(const cn_colmap_job *j, const char *stage, const char *what)
{
    return cn_format("%s/%s.%s.json", j->dir, stage, what);
}

bool cn_job_is_marked(const cn_colmap_job *j, const char *what)
{
    char *path = cn_job_marker(j, j->stage, what), mine[17];
    const char *theirs;
    json_t *root = NULL;
    int64_t version = 0;
    cn_hash_hex(j->chain, mine);
    bool marked = path && cn_file_exists(path) && cn_json_load(path, &root) == CN_OK &&
                  cn_json_integer(root, path, "version", &version) == CN_OK && version == MARKER_VERSION &&
                  cn_json_string(root, path, "work", &theirs) == CN_OK && strcmp(mine, theirs) == 0;
    json_decref(root);
    free(path);
    return marked;
}

bool cn_job_is_done(const cn_colmap_job *j)
{
    return cn_job_is_marked(j, "done");
}

cn_status cn_job_mark(const cn_colmap_job *j, const char *what)
{
    char hex[17], *path = cn_job_marker(j, j->stage, what);
    cn_hash_hex(j->chain, hex);
    json_t *root = json_pack("{s:i, s:s, s:s}", "version", MARKER_VERSION, "stage", j->stage, "work", hex);
    cn_status status = path && root ? cn_json_save(root, path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    json_decref(root);
    free(path);
    return status;
}

cn_status cn_job_mark_done(const cn_colmap_job *j)
{
    return cn_job_mark(j, "done");
}

cn_status cn_job_remove_marker(const cn_colmap_job *j, const char *stage, const char *what)
{
    char *path = cn_job_marker(j, stage, what);
    cn_status status = path ? cn_file_remove(path) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    return status;
}

cn_status cn_job_unmark(const cn_colmap_job *j)
{
    return cn_job_remove_marker(j, j->stage, "done");
}

void cn_job_begin(cn_colmap_job *j, const char *stage, double total)
{
    j->stage = stage;
    j->started_s = cn_now_s();
    j->advanced_s = j->started_s;
    j->told_s = -INFINITY;
    j->base = j->done = j->step_s = 0.0;
    j->left_s = -1.0;
    j->part = j->total = total;
}

void cn_job_mix(cn_colmap_job *j, const void *data, size_t size)
{
    uint64_t both[2] = { j->chain, cn_hash64(data, size) };
    j->chain = cn_hash64(both, sizeof both);
}

void cn_job_mix_words(cn_colmap_job *j, const char *const *words)
{
    for (; words && *words; words++)
        cn_job_mix(j, *words, strlen(*words));
}

void cn_job_words(const char **argv, int *n, const char *const *words)
{
    for (; words && *words; words++)
        argv[(*n)++] = *words;
    argv[*n] = NULL;
}
