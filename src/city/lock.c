#include "city/lock.h"

#include "base/clock.h"
#include "base/file.h"
#include "base/json.h"
#include "city/workspace.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

/* Resident bytes of this process; 0 when the system does not say. */
static double resident_bytes(void)
{
    FILE *stream = fopen("/proc/self/statm", "re");
    long pages = 0;
    if (!stream) return 0;
    if (fscanf(stream, "%*s %ld", &pages) != 1) pages = 0;
    fclose(stream);
    return (double)pages * (double)sysconf(_SC_PAGESIZE);
}

static void note(cn_city_lock *lock, const cn_progress_report *r)
{
    json_t *root =
        json_pack("{s:s,s:s,s:f,s:f,s:f,s:f,s:s,s:f,s:f}", "stage", r->stage, "item", r->item ? r->item : "", "done",
                  r->done, "total", r->total, "elapsed_s", r->elapsed_s, "left_s", r->left_s, "detail",
                  r->detail ? r->detail : "", "memory_bytes", resident_bytes(), "at", (double)time(NULL));
    char *text = root ? json_dumps(root, JSON_COMPACT | JSON_REAL_PRECISION(9)) : NULL;
    if (text) cn_lock_note(lock->lock, text);
    free(text);
    json_decref(root);
}

static void pass_log(void *user, cn_log_level level, const char *text)
{
    cn_log(((cn_city_lock *)user)->outer, level, "%s", text);
}

static void pass_progress(void *user, const cn_progress_report *report)
{
    cn_city_lock *lock = user;
    cn_progress(lock->outer, report);
    const double now = cn_now_s();
    if (now - lock->noted < 1) return;
    lock->noted = now;
    note(lock, report);
}

static cn_status take(cn_city_lock *lock, const cn_context *ctx, const char *folder, const char *name, const char *what,
                      double age_s)
{
    *lock = (cn_city_lock){ .outer = ctx };
    if (ctx) lock->ctx = *ctx;
    lock->ctx.log = pass_log;
    lock->ctx.progress = pass_progress;
    lock->ctx.user = lock;
    char *path = cn_path_join(folder, name);
    cn_status status = path ? cn_folder_make(folder) : cn_fail(CN_ERR_NOMEM, "out of memory");
    if (status == CN_OK) status = cn_lock_take(&lock->lock, path, what);
    if (status == CN_OK) status = cn_folder_sweep(folder, NULL, age_s);
    free(path);
    if (status != CN_OK) cn_city_lock_drop(lock);
    return status;
}

cn_status cn_city_lock_take(cn_city_lock *lock, const cn_context *ctx, const cn_city *city, const char *folder,
                            const char *what)
{
    char *path = cn_city_path(city, folder);
    *lock = (cn_city_lock){ 0 };
    const cn_status status = path ? take(lock, ctx, path, "LOCK", what, 0) : cn_fail(CN_ERR_NOMEM, "out of memory");
    free(path);
    return status;
}

cn_status cn_city_lock_share(cn_city_lock *lock, const cn_context *ctx, const char *folder, const char *name,
                             const char *what)
{
    return take(lock, ctx, folder, name, what, CN_LOCK_STALE_S);
}

void cn_city_lock_tidy(const cn_city *city, const char *folder)
{
    char *path = cn_format("%s/%s/LOCK", city->folder, folder);
    cn_lock_state state = { 0 };
    cn_city_lock lock;
    if (path) cn_lock_look(path, &state);
    /* A file that cannot be removed does no harm. */
    if (state.there && !state.held && cn_city_lock_take(&lock, NULL, city, folder, folder) == CN_OK)
        cn_city_lock_drop(&lock);
    free(path);
}

void cn_city_lock_drop(cn_city_lock *lock)
{
    cn_lock_release(&lock->lock);
}
