#include "stage/device.h"

#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>

cn_status cn_stage_device(const cn_context *ctx, const cn_city *city, cn_device **device)
{
    const char *name = city->config.device;
    *device = NULL;
    if (!name || (ctx->device && !cn_device_about(ctx->device)->automatic)) return CN_OK;
    const cn_status status = cn_device_create(name, device);
    if (status == CN_ERR_USAGE)
        return cn_fail(CN_ERR_CONFIG, "%s/city.yaml: train.device: %s", city->folder, cn_error_message());
    if (status != CN_OK) cn_log(ctx, CN_LOG_WARN, "train.device: %s; the processor does the work", cn_error_message());
    for (const cn_device *d = *device; d; d = cn_device_next(d))
        cn_log(ctx, CN_LOG_INFO, "device: %s", cn_device_about(d)->name);
    return CN_OK;
}

/* ---- several at once ---- */

enum { WHY = 1024 };

/* What a thread says. It waits until the caller's thread has passed it on. */
typedef struct saying {
    const cn_progress_report *report; /* NULL: a line of the log */
    cn_log_level level;
    const char *text;
    bool passed_on;
} saying;

typedef struct team {
    const cn_context *ctx;
    cn_device_work *work;
    void *user;
    pthread_mutex_t lock; /* of all that follows */
    pthread_cond_t changed;
    saying *say; /* NULL: nobody has anything to say */
    uint32_t next, n, working;
    cn_status bad;
    char why[WHY];
} team;

typedef struct member {
    team *team;
    cn_context ctx;
    pthread_t thread;
} member;

static void say(team *t, saying *what)
{
    pthread_mutex_lock(&t->lock);
    while (t->say)
        pthread_cond_wait(&t->changed, &t->lock);
    t->say = what;
    pthread_cond_broadcast(&t->changed);
    while (!what->passed_on)
        pthread_cond_wait(&t->changed, &t->lock);
    pthread_mutex_unlock(&t->lock);
}

static void say_line(void *user, cn_log_level level, const char *text)
{
    say(((member *)user)->team, &(saying){ .level = level, .text = text });
}

static void say_progress(void *user, const cn_progress_report *report)
{
    say(((member *)user)->team, &(saying){ .report = report });
}

static bool take_next(team *t, uint32_t *item)
{
    pthread_mutex_lock(&t->lock);
    const bool more = t->next < t->n && t->bad == CN_OK;
    *item = more ? t->next++ : 0;
    pthread_mutex_unlock(&t->lock);
    return more;
}

static void *work_through(void *user)
{
    member *m = user;
    team *t = m->team;
    cn_status status = CN_OK;
    for (uint32_t item; status == CN_OK && take_next(t, &item);)
        status = t->work(t->user, &m->ctx, item);
    pthread_mutex_lock(&t->lock);
    if (status != CN_OK && t->bad == CN_OK) {
        t->bad = status;
        snprintf(t->why, sizeof t->why, "%s", cn_error_message());
    }
    t->working--;
    pthread_cond_broadcast(&t->changed);
    pthread_mutex_unlock(&t->lock);
    return NULL;
}

/* Passes on what the threads say, until all have ended. */
static void listen(team *t)
{
    pthread_mutex_lock(&t->lock);
    while (t->working || t->say) {
        if (!t->say) {
            pthread_cond_wait(&t->changed, &t->lock);
            continue;
        }
        if (t->say->report)
            cn_progress(t->ctx, t->say->report);
        else
            cn_log(t->ctx, t->say->level, "%s", t->say->text);
        t->say->passed_on = true;
        t->say = NULL;
        pthread_cond_broadcast(&t->changed);
    }
    pthread_mutex_unlock(&t->lock);
}

/* Signals reach the caller's thread, which listens, and not the others. */
static cn_status start(team *t, member *m)
{
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    pthread_mutex_lock(&t->lock);
    const bool started = pthread_create(&m->thread, NULL, work_through, m) == 0;
    t->working += started;
    pthread_mutex_unlock(&t->lock);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return started ? CN_OK : cn_fail(CN_ERR_NOMEM, "the system refuses a thread");
}

static cn_status work_together(team *t, member *members, uint32_t n)
{
    const unsigned all = cn_pool_threads(t->ctx->pool), share = all / n ? all / n : 1;
    cn_device *device = t->ctx->device;
    uint32_t started = 0;
    cn_status status = CN_OK;
    for (; started < n; started++, device = cn_device_next(device)) {
        member *m = &members[started];
        *m = (member){
            .team = t,
            .ctx = { .log = say_line, .progress = say_progress, .user = m, .stop = t->ctx->stop, .device = device }
        };
        status = cn_pool_create(&m->ctx.pool, share);
        if (status == CN_OK) status = start(t, m);
        if (status == CN_OK) continue;
        cn_pool_destroy(&m->ctx.pool);
        break;
    }
    listen(t);
    for (uint32_t i = 0; i < started; i++) {
        pthread_join(members[i].thread, NULL);
        cn_pool_destroy(&members[i].ctx.pool);
    }
    /* One that could not start is no failure while others did the work. */
    if (!started) return status;
    return t->bad == CN_OK ? CN_OK : cn_fail(t->bad, "%s", t->why);
}

cn_status cn_devices_run(const cn_context *ctx, uint32_t n, cn_device_work *work, void *user)
{
    uint32_t n_devices = 0;
    for (const cn_device *d = ctx->device; d && n_devices < n; d = cn_device_next(d))
        n_devices++;
    if (n_devices < 2) {
        for (uint32_t i = 0; i < n; i++)
            CN_TRY(work(user, ctx, i));
        return CN_OK;
    }
    member *members = calloc(n_devices, sizeof *members);
    team t = { .ctx = ctx, .work = work, .user = user, .n = n };
    if (!members) return cn_fail(CN_ERR_NOMEM, "out of memory");
    pthread_mutex_init(&t.lock, NULL);
    pthread_cond_init(&t.changed, NULL);
    const cn_status status = work_together(&t, members, n_devices);
    pthread_cond_destroy(&t.changed);
    pthread_mutex_destroy(&t.lock);
    free(members);
    return status;
}
