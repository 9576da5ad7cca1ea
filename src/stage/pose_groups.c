#include "stage/pose_groups.h"

#include "base/clock.h"
#include "base/file.h"
#include "city/lock.h"
#include "city/workspace.h"

#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { THREADS_EACH = 4, LINES = 256, LINE = 480, PAUSE_MS = 200, MOST_AT_ONCE = 64 };

cn_status cn_pose_groups_map_one(const cn_context *ctx, const cn_city *city, const cn_pose_work *work, uint32_t group)
{
    char folder[64], what[64];
    cn_city_lock lock;
    snprintf(folder, sizeof folder, "poses/groups/%03u", group + 1);
    snprintf(what, sizeof what, "group %u", group + 1);
    if (cn_pose_group_look(work, group) == CN_POSE_GROUP_DONE) {
        cn_city_lock_tidy(city, folder);
        cn_log(ctx, CN_LOG_INFO, "group %u is done", group + 1);
        return CN_OK;
    }
    CN_TRY(cn_city_lock_take(&lock, ctx, city, folder, what));
    /* Another process may have mapped it in between. */
    const cn_status status =
        cn_pose_group_look(work, group) == CN_POSE_GROUP_DONE ? CN_OK : cn_pose_map_group(&lock.ctx, work, group);
    cn_city_lock_drop(&lock);
    return status;
}

/* What threads say, until the caller's thread passes it on: callbacks run on that one. */
typedef struct post {
    pthread_mutex_t lock;
    uint32_t n, n_lost;
    struct {
        cn_log_level level;
        char text[LINE];
    } lines[LINES];
} post;

typedef struct team {
    const cn_context *ctx;
    const cn_city *city;
    const cn_pose_work *work;
    uint32_t *due, n_due, next, n_done; /* next, n_done: under the post's lock */
    uint32_t n_failed, n_locked;
    cn_status bad; /* stopped */
    post post;
} team;
typedef struct member {
    team *team;
    uint32_t group;
    unsigned n_threads;
    pthread_t thread;
} member;

static void put(team *t, cn_log_level level, const char *text)
{
    pthread_mutex_lock(&t->post.lock);
    if (t->post.n < LINES) {
        t->post.lines[t->post.n].level = level;
        snprintf(t->post.lines[t->post.n++].text, LINE, "%s", text);
    } else {
        t->post.n_lost++;
    }
    pthread_mutex_unlock(&t->post.lock);
}

static void put_line(void *user, cn_log_level level, const char *text)
{
    const member *m = user;
    char line[LINE];
    snprintf(line, sizeof line, "group %u: %s", m->group + 1, text);
    put(m->team, level, line);
}

/* Takes note of how a group ended. */
static void note_end(team *t, uint32_t group, cn_status status)
{
    char line[LINE];
    snprintf(line, sizeof line, "group %u: %.400s", group + 1, cn_error_message());
    if (status != CN_OK && status != CN_ERR_INTERRUPTED) put(t, CN_LOG_WARN, line);
    pthread_mutex_lock(&t->post.lock);
    t->n_done++;
    t->n_failed += status != CN_OK && status != CN_ERR_LOCKED && status != CN_ERR_INTERRUPTED;
    t->n_locked += status == CN_ERR_LOCKED;
    if (status == CN_ERR_INTERRUPTED) t->bad = status;
    pthread_mutex_unlock(&t->post.lock);
}

/* The next group; UINT32_MAX: none, or the work has to stop. */
static uint32_t take_next(team *t)
{
    pthread_mutex_lock(&t->post.lock);
    const bool more = t->next < t->n_due && t->bad == CN_OK;
    const uint32_t group = more ? t->due[t->next++] : UINT32_MAX;
    pthread_mutex_unlock(&t->post.lock);
    return group;
}

static void *work_through(void *user)
{
    member *m = user;
    cn_context ctx = { .log = put_line, .user = m, .stop = m->team->ctx ? m->team->ctx->stop : NULL };
    cn_status status = cn_pool_create(&ctx.pool, m->n_threads);
    while (status != CN_ERR_INTERRUPTED && (m->group = take_next(m->team)) != UINT32_MAX) {
        status = ctx.pool ? cn_pose_groups_map_one(&ctx, m->team->city, m->team->work, m->group) : status;
        note_end(m->team, m->group, status);
    }
    cn_pool_destroy(&ctx.pool);
    return NULL;
}

/* Passes on what the threads said. True when all groups are done, or the threads have stopped. */
static bool pass_on(team *t, double began_s)
{
    post *copy = malloc(sizeof *copy);
    pthread_mutex_lock(&t->post.lock);
    const uint32_t n_done = t->n_done;
    const bool over = n_done == t->n_due || t->bad != CN_OK;
    if (copy) {
        *copy = t->post;
        t->post.n = t->post.n_lost = 0;
    }
    pthread_mutex_unlock(&t->post.lock);
    for (uint32_t i = 0; copy && i < copy->n; i++)
        cn_log(t->ctx, copy->lines[i].level, "%s", copy->lines[i].text);
    if (copy && copy->n_lost) cn_log(t->ctx, CN_LOG_WARN, "%u further lines of the groups' logs", copy->n_lost);
    free(copy);
    const double spent = cn_now_s() - began_s;
    const cn_progress_report report = { "poses",  "groups", n_done,
                                        t->n_due, spent,    n_done ? spent * (t->n_due - n_done) / n_done : -1,
                                        NULL };
    cn_progress(t->ctx, &report);
    return over;
}

/* The caller's thread only listens. Signals reach it, not the others. */
static cn_status work_together(team *t, unsigned n, unsigned threads_each)
{
    member members[MOST_AT_ONCE];
    sigset_t all, before;
    unsigned started = 0;
    const double began_s = cn_now_s();
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    for (; started < n; started++) {
        members[started] = (member){ .team = t, .n_threads = threads_each };
        if (pthread_create(&members[started].thread, NULL, work_through, &members[started]) != 0) break;
    }
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    if (!started) return cn_fail(CN_ERR_NOMEM, "the system refuses a thread");
    const struct timespec pause = { .tv_nsec = PAUSE_MS * 1000000L };
    while (!pass_on(t, began_s))
        nanosleep(&pause, NULL);
    for (unsigned i = 0; i < started; i++)
        pthread_join(members[i].thread, NULL);
    (void)pass_on(t, began_s);
    return CN_OK;
}

static void work_alone(team *t)
{
    for (uint32_t group; (group = take_next(t)) != UINT32_MAX;) {
        cn_log(t->ctx, CN_LOG_INFO, "group %u (%u of %u that are due)", group + 1, t->next, t->n_due);
        const cn_status status = cn_pose_groups_map_one(t->ctx, t->city, t->work, group);
        note_end(t, group, status);
        for (uint32_t i = 0; i < t->post.n; i++)
            cn_log(t->ctx, t->post.lines[i].level, "%s", t->post.lines[i].text);
        t->post.n = 0;
    }
}

cn_status cn_pose_groups_map(const cn_context *ctx, const cn_city *city, const cn_pose_work *work, uint32_t n_groups)
{
    team *t = calloc(1, sizeof *t);
    uint32_t *due = malloc((n_groups + (size_t)1) * sizeof *due);
    if (!t || !due) {
        free(t);
        free(due);
        return cn_fail(CN_ERR_NOMEM, "out of memory");
    }
    *t = (team){ .ctx = ctx, .city = city, .work = work, .due = due };
    pthread_mutex_init(&t->post.lock, NULL);
    for (uint32_t i = 0; i < n_groups; i++) {
        const cn_pose_group_state state = cn_pose_group_look(work, i);
        if (state == CN_POSE_GROUP_DUE || state == CN_POSE_GROUP_FAILED) due[t->n_due++] = i;
    }
    const unsigned threads = cn_pool_threads(ctx ? ctx->pool : NULL);
    unsigned at_once = threads / THREADS_EACH < MOST_AT_ONCE ? threads / THREADS_EACH : MOST_AT_ONCE;
    if (at_once > t->n_due) at_once = t->n_due;
    cn_status status = CN_OK;
    if (at_once > 1)
        status = work_together(t, at_once, threads / at_once);
    else
        work_alone(t);
    if (status == CN_OK && t->bad != CN_OK)
        status =
            cn_fail(t->bad, "stopped; %u of %u groups were due; run the same command to resume", t->n_due, n_groups);
    else if (status == CN_OK && t->n_locked)
        status =
            cn_fail(CN_ERR_LOCKED,
                    "%u groups are being mapped by other processes; run the same command again when these are done",
                    t->n_locked);
    pthread_mutex_destroy(&t->post.lock);
    free(due);
    free(t);
    return status;
}
