/* Jobs: submitted from any thread, rendered pass by pass on the renderer's thread. */
#include "renderer/renderer.h"

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { POLL_NS = 50000000 }; /* how often a waiting thread checks the stop flag */

/* ---- a job ---- */

static void job_unref(cn_render_job *job)
{
    if (__atomic_sub_fetch(&job->references, 1, __ATOMIC_ACQ_REL)) return;
    for (size_t i = 0; i < sizeof job->texts / sizeof *job->texts; i++)
        free(job->texts[i]);
    cn_appearance_spec_deinit(&job->spec);
    cn_picture_deinit(&job->picture);
    free(job->encoded);
    free(job->owners);
    cn_aovs_deinit(&job->aovs);
    pthread_cond_destroy(&job->ended);
    pthread_mutex_destroy(&job->lock);
    free(job);
}

static bool copy_text(cn_render_job *job, size_t i, const char **text)
{
    if (!*text) return true;
    *text = job->texts[i] = strdup(*text);
    return *text != NULL;
}

static cn_status job_create(const cn_render_request *request, cn_render_job **out)
{
    cn_render_job *job = *out = calloc(1, sizeof *job);
    if (!job) return cn_fail(CN_ERR_NOMEM, "out of memory for a render job");
    job->request = *request;
    job->passes = request->passes & CN_PASS_ALL;
    job->references = 1;
    pthread_mutex_init(&job->lock, NULL);
    pthread_cond_init(&job->ended, NULL);
    cn_render_request *r = &job->request;
    r->view.name = NULL;
    if (r->row) job->row = *r->row, r->row = &job->row;
    if (r->crop_m) r->crop_m = memcpy(job->crop_m, r->crop_m, sizeof job->crop_m);
    const bool copied = copy_text(job, 0, &r->appearance) && copy_text(job, 1, &r->tile) &&
                        copy_text(job, 2, &r->blend) && copy_text(job, 3, &r->display_view) &&
                        copy_text(job, 4, &r->look);
    if (copied) return CN_OK;
    job_unref(job);
    *out = NULL;
    return cn_fail(CN_ERR_NOMEM, "out of memory for a render job");
}

/* Call with the job's lock held. A job ends once. */
static void end(cn_render_job *job, cn_status status, const char *message)
{
    if (job->state == CN_JOB_ENDED) return;
    job->state = CN_JOB_ENDED;
    job->status = status;
    snprintf(job->message, sizeof job->message, "%s", message);
    pthread_cond_broadcast(&job->ended);
}

void cn_renderer_cancel(cn_render_job *job)
{
    cn_stop(&job->stop);
    pthread_mutex_lock(&job->lock);
    job->samples_at_cancel = __atomic_load_n(&job->samples, __ATOMIC_RELAXED);
    /* End the job now, so that a waiting thread need not wait for other jobs. The queue drops it later. */
    if (job->state == CN_JOB_QUEUED) end(job, CN_ERR_INTERRUPTED, "the job was cancelled");
    pthread_mutex_unlock(&job->lock);
}

cn_status cn_renderer_wait(cn_render_job *job, const cn_context *ctx, cn_render_result *result)
{
    pthread_mutex_lock(&job->lock);
    while (job->state != CN_JOB_ENDED) {
        struct timespec until;
        clock_gettime(CLOCK_REALTIME, &until);
        until.tv_nsec += POLL_NS;
        until.tv_sec += until.tv_nsec / 1000000000;
        until.tv_nsec %= 1000000000;
        if (pthread_cond_timedwait(&job->ended, &job->lock, &until) != ETIMEDOUT || !cn_stopping(ctx)) continue;
        pthread_mutex_unlock(&job->lock);
        cn_renderer_cancel(job);
        pthread_mutex_lock(&job->lock);
    }
    const cn_status status = job->status;
    pthread_mutex_unlock(&job->lock);
    if (status != CN_OK) return cn_fail(status, "%s", job->message);
    if (result) *result = job->result;
    return CN_OK;
}

void cn_renderer_release(cn_render_job **job)
{
    if (*job) job_unref(*job);
    *job = NULL;
}

/* ---- the queue ---- */

/* Whether a comes before the older job b. */
static bool before(const cn_render_job *a, const cn_render_job *b)
{
    if (a->request.priority != b->request.priority) return a->request.priority > b->request.priority;
    return (a->passes & -a->passes) < (b->passes & -b->passes);
}

static cn_render_job *choose(cn_renderer *r)
{
    cn_render_job *best = NULL;
    for (cn_render_job *job = r->first; job; job = job->next) {
        if (__atomic_load_n(&job->stop, __ATOMIC_RELAXED))
            return job; /* take a cancelled job first: it only has to be removed */
        if (!best || before(job, best)) best = job;
    }
    return best;
}

static void drop(cn_renderer *r, cn_render_job *job)
{
    pthread_mutex_lock(&r->lock);
    for (cn_render_job **at = &r->first; *at; at = &(*at)->next)
        if (*at == job) {
            *at = job->next;
            break;
        }
    pthread_mutex_unlock(&r->lock);
    job_unref(job);
}

/* Puts a job back into the queue after a pass. False when it was cancelled meanwhile. */
static bool go_on(cn_render_job *job)
{
    pthread_mutex_lock(&job->lock);
    const bool on = !__atomic_load_n(&job->stop, __ATOMIC_RELAXED);
    if (on) job->state = CN_JOB_QUEUED;
    pthread_mutex_unlock(&job->lock);
    return on;
}

static void finish(cn_renderer *r, cn_render_job *job, cn_status status)
{
    const cn_render_request *q = &job->request;
    char message[sizeof job->message];
    snprintf(message, sizeof message, "%s", status == CN_OK ? "" : cn_error_message());
    if (status != CN_OK && q->deliver) q->deliver(q->user, job, status, NULL);
    pthread_mutex_lock(&job->lock);
    end(job, status, message);
    pthread_mutex_unlock(&job->lock);
    drop(r, job);
}

static void run(cn_renderer *r, cn_render_job *job)
{
    const cn_render_request *q = &job->request;
    pthread_mutex_lock(&job->lock);
    const bool cancelled = job->state == CN_JOB_ENDED || __atomic_load_n(&job->stop, __ATOMIC_RELAXED);
    if (!cancelled) job->state = CN_JOB_RUNNING;
    pthread_mutex_unlock(&job->lock);
    cn_status status = cancelled ? cn_fail(CN_ERR_INTERRUPTED, "the job was cancelled") : cn_render_job_pass(r, job);
    if (status == CN_OK && q->deliver) q->deliver(q->user, job, CN_OK, &job->result);
    if (status == CN_OK && job->passes && go_on(job)) return;
    if (status == CN_OK && job->passes) status = cn_fail(CN_ERR_INTERRUPTED, "the job was cancelled");
    finish(r, job, status);
}

static void *work(void *user)
{
    cn_renderer *r = user;
    pthread_mutex_lock(&r->lock);
    for (;;) {
        while (!r->first && !r->closing)
            pthread_cond_wait(&r->changed, &r->lock);
        cn_render_job *job = choose(r);
        if (!job) break;
        pthread_mutex_unlock(&r->lock);
        run(r, job);
        pthread_mutex_lock(&r->lock);
    }
    pthread_mutex_unlock(&r->lock);
    return NULL;
}

/* Call with the lock held. Signals go to the caller's threads. */
static cn_status start(cn_renderer *r)
{
    sigset_t all, old;
    if (r->started) return CN_OK;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &old);
    r->started = pthread_create(&r->thread, NULL, work, r) == 0;
    pthread_sigmask(SIG_SETMASK, &old, NULL);
    return r->started ? CN_OK : cn_fail(CN_ERR_NOMEM, "the system cannot start a thread for the renderer");
}

/* Under the lock. */
static void append(cn_renderer *r, cn_render_job *job)
{
    cn_render_job **at = &r->first;
    for (; *at; at = &(*at)->next)
        if (job->request.stream && (*at)->request.stream == job->request.stream) cn_renderer_cancel(*at);
    *at = job;
    pthread_cond_signal(&r->changed);
}

static cn_status check(const cn_render_request *q)
{
    if (!(q->passes & CN_PASS_ALL)) return cn_fail(CN_ERR_USAGE, "a render job without a pass; give CN_PASS_FULL");
    if (!q->camera.width || !q->camera.height || q->camera.width > 65535 || q->camera.height > 65535)
        return cn_fail(CN_ERR_USAGE, "a picture of %u x %u pixels cannot be made; give 1 to 65535 pixels for each side",
                       q->camera.width, q->camera.height);
    if (q->quality < 0 || q->quality > 100)
        return cn_fail(CN_ERR_USAGE, "JPEG of quality %d; give 1 to 100", q->quality);
    return q->row && !q->tile ? cn_fail(CN_ERR_USAGE, "a row belongs to one tile: name the tile") : CN_OK;
}

cn_status cn_renderer_submit(cn_renderer *r, const cn_render_request *request, cn_render_job **out)
{
    cn_render_job *job;
    if (out) *out = NULL;
    CN_TRY(check(request));
    CN_TRY(job_create(request, &job));
    if (out) job->references++;
    pthread_mutex_lock(&r->lock);
    const cn_status status = r->closing ? cn_fail(CN_ERR_INTERRUPTED, "the renderer is being destroyed") : start(r);
    if (status == CN_OK) append(r, job);
    pthread_mutex_unlock(&r->lock);
    if (status != CN_OK) {
        job->references = 1;
        job_unref(job);
    } else if (out) {
        *out = job;
    }
    return status;
}

void cn_renderer_queue_close(cn_renderer *r)
{
    pthread_mutex_lock(&r->lock);
    r->closing = true;
    for (cn_render_job *job = r->first; job; job = job->next)
        cn_renderer_cancel(job);
    pthread_cond_signal(&r->changed);
    pthread_mutex_unlock(&r->lock);
    if (r->started) pthread_join(r->thread, NULL);
}
