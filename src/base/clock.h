/* Clocks in seconds. */
#ifndef CONURB_BASE_CLOCK_H
#define CONURB_BASE_CLOCK_H
#include <time.h>

/* Reads `clock`: CLOCK_MONOTONIC, CLOCK_PROCESS_CPUTIME_ID, ... Any thread. */
static inline double cn_clock_s(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Elapsed time since an arbitrary start. Changes of the system's clock do not affect it. */
static inline double cn_now_s(void)
{
    return cn_clock_s(CLOCK_MONOTONIC);
}
#endif
