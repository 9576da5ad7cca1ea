/* Asks a running pool to stop, from another thread. Built with the thread sanitizer, which ends a program with a data
 * race with exit code 66. A plain or volatile int would be such a race. */
#include "conurb/base.h"

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdio.h>

enum { THREADS = 4 };

typedef struct shared {
    cn_context ctx;
    int stop;
    atomic_int at_work, stopped;
} shared;

static void work(void *user, size_t item, unsigned worker)
{
    (void)item;
    (void)worker;
    shared *s = user;
    atomic_fetch_add(&s->at_work, 1);
    while (!cn_stopping(&s->ctx))
        sched_yield();
    atomic_fetch_add(&s->stopped, 1);
}

static void *ask(void *user)
{
    shared *s = user;
    while (!atomic_load(&s->at_work))
        sched_yield();
    cn_stop(&s->stop);
    return NULL;
}

int main(void)
{
    static shared s;
    pthread_t asking;
    s.ctx.stop = &s.stop;
    if (cn_pool_create(&s.ctx.pool, THREADS) != CN_OK || pthread_create(&asking, NULL, ask, &s) != 0) return 1;
    cn_pool_run(s.ctx.pool, THREADS, work, &s);
    pthread_join(asking, NULL);
    cn_pool_destroy(&s.ctx.pool);
    printf("%d of %d items stopped\n", atomic_load(&s.stopped), THREADS);
    return atomic_load(&s.stopped) == THREADS ? 0 : 1;
}
