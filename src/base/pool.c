/* A pool of persistent threads. The caller works too (as worker 0), so a pool of n threads starts n - 1. */
#include "conurb/base.h"

#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <sched.h>
#include <stdalign.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#define CN_CACHE_LINE 64
#define CN_POOL_MAX_THREADS 1024

typedef struct worker {
    cn_pool *pool;
    pthread_t thread;
    unsigned index;
} worker;

struct cn_pool {
    /* Every thread writes this for every item, so it has a cache line of its own. */
    alignas(CN_CACHE_LINE) atomic_size_t next;
    /* Every thread reads these for every item; they are written only between runs. */
    alignas(CN_CACHE_LINE) void (*task)(void *user, size_t i, unsigned worker);
    void *user;
    size_t n;
    /* Protected by the lock. */
    alignas(CN_CACHE_LINE) pthread_mutex_t lock;
    pthread_cond_t start, finish;
    uint64_t round; /* number of the run; a worker joins each run once */
    unsigned busy;  /* workers that have not finished this round */
    bool closing;
    unsigned n_threads, n_started;
    worker workers[];
};

static void work(cn_pool *pool, unsigned index)
{
    size_t i;
    /* The lock at the start and end of each run orders memory; the counter only distributes the items. */
    while ((i = atomic_fetch_add_explicit(&pool->next, 1, memory_order_relaxed)) < pool->n)
        pool->task(pool->user, i, index);
}

static void *worker_main(void *argument)
{
    worker *self = argument;
    cn_pool *pool = self->pool;
    uint64_t seen = 0;
    pthread_mutex_lock(&pool->lock);
    for (;;) {
        while (!pool->closing && pool->round == seen)
            pthread_cond_wait(&pool->start, &pool->lock);
        if (pool->closing) break;
        seen = pool->round;
        pthread_mutex_unlock(&pool->lock);
        work(pool, self->index);
        pthread_mutex_lock(&pool->lock);
        if (--pool->busy == 0) pthread_cond_signal(&pool->finish);
    }
    pthread_mutex_unlock(&pool->lock);
    return NULL;
}

static unsigned processors_allowed(void)
{
    /* The kernel refuses a set smaller than its own: grow until it accepts. */
    for (int cpus = 1024; cpus <= 1 << 20; cpus *= 2) {
        cpu_set_t *set = CPU_ALLOC(cpus);
        if (!set) break;
        size_t bytes = CPU_ALLOC_SIZE(cpus);
        CPU_ZERO_S(bytes, set);
        int result = sched_getaffinity(0, bytes, set);
        int error = errno;
        int count = result == 0 ? CPU_COUNT_S(bytes, set) : 0;
        CPU_FREE(set);
        if (count > 0) return count < CN_POOL_MAX_THREADS ? (unsigned)count : CN_POOL_MAX_THREADS;
        if (error != EINVAL) break;
    }
    return 1;
}

/* Signals go to the caller's threads; a worker that handled one would delay the stop. */
static int start_workers(cn_pool *pool)
{
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int error = 0;
    for (unsigned k = 0; k + 1 < pool->n_threads && !error; k++) {
        pool->workers[k] = (worker){ .pool = pool, .index = k + 1 };
        error = pthread_create(&pool->workers[k].thread, NULL, worker_main, &pool->workers[k]);
        if (!error) pool->n_started++;
    }
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return error;
}

cn_status cn_pool_create(cn_pool **out, unsigned n_threads)
{
    *out = NULL;
    if (n_threads > CN_POOL_MAX_THREADS)
        return cn_fail(CN_ERR_USAGE, "%u threads are too many: give at most %d, or 0 for one per processor", n_threads,
                       CN_POOL_MAX_THREADS);
    if (n_threads == 0) n_threads = processors_allowed();
    size_t bytes = sizeof(cn_pool) + (n_threads - 1) * sizeof(worker);
    bytes = (bytes + CN_CACHE_LINE - 1) / CN_CACHE_LINE * CN_CACHE_LINE;
    cn_pool *pool = aligned_alloc(CN_CACHE_LINE, bytes);
    if (!pool) return cn_fail(CN_ERR_NOMEM, "out of memory for a pool of %u threads", n_threads);
    memset(pool, 0, bytes);
    atomic_init(&pool->next, 0);
    pool->n_threads = n_threads;
    pthread_mutex_init(&pool->lock, NULL);
    pthread_cond_init(&pool->start, NULL);
    pthread_cond_init(&pool->finish, NULL);
    int error = start_workers(pool);
    if (error) {
        unsigned started = pool->n_started;
        cn_pool_destroy(&pool);
        return cn_fail(CN_ERR_NOMEM, "the system started %u of %u threads: %s; ask for fewer threads", started + 1,
                       n_threads, strerror(error));
    }
    *out = pool;
    return CN_OK;
}

void cn_pool_destroy(cn_pool **in)
{
    cn_pool *pool = *in;
    if (!pool) return;
    pthread_mutex_lock(&pool->lock);
    pool->closing = true;
    pthread_cond_broadcast(&pool->start);
    pthread_mutex_unlock(&pool->lock);
    for (unsigned k = 0; k < pool->n_started; k++)
        pthread_join(pool->workers[k].thread, NULL);
    pthread_cond_destroy(&pool->finish);
    pthread_cond_destroy(&pool->start);
    pthread_mutex_destroy(&pool->lock);
    free(pool);
    *in = NULL;
}

unsigned cn_pool_threads(const cn_pool *pool)
{
    return pool ? pool->n_threads : 1;
}

void cn_pool_run(cn_pool *pool, size_t n, void (*task)(void *user, size_t i, unsigned worker), void *user)
{
    if (!pool || pool->n_threads == 1 || n <= 1) {
        for (size_t i = 0; i < n; i++)
            task(user, i, 0);
        return;
    }
    pthread_mutex_lock(&pool->lock);
    pool->task = task;
    pool->user = user;
    pool->n = n;
    atomic_store_explicit(&pool->next, 0, memory_order_relaxed);
    pool->busy = pool->n_started;
    pool->round++;
    pthread_cond_broadcast(&pool->start);
    pthread_mutex_unlock(&pool->lock);
    work(pool, 0);
    pthread_mutex_lock(&pool->lock);
    while (pool->busy > 0)
        pthread_cond_wait(&pool->finish, &pool->lock);
    pthread_mutex_unlock(&pool->lock);
}
